"""The control process: 50 Hz between the lines and the compiled step."""
