"""A skid-steer vehicle in the control loop: a field worked along a coverage plan."""
