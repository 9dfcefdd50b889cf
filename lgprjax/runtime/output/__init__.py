"""The corrected position for others: NMEA sentences, and a live view."""
