"""The operator's display: a page served on the vehicle, and the one thing it may ask for, another route."""
