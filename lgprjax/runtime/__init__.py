"""The onboard runtime: ports, processes, watchdogs, recorder, operator display."""
