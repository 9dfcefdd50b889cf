"""Evidence that takes longer than the suite: independent worlds, full-wave lines, hidden vehicles, field campaigns.

``python -m validation`` runs it (``make validation NAME=...``). Each folder is one validation. Outside the wheel.
"""
