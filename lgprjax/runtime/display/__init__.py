"""The operator's display: a page served on the vehicle, and its only request, another route."""
