"""The control process: the 50 Hz loop around the compiled step."""
