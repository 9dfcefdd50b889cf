"""The registration process: scans in, fixes out."""
