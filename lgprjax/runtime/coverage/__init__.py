"""The coverage process: the live map of worked ground."""
