"""What goes wrong with the simulated devices of a field: names, and what each must say of itself."""

FIELD_LINES = ("drive_by_wire", "controller", "gnss")
FIELD_FAULTS: dict[str, tuple[str, ...]] = {
    "gnss_off": (),
    "gnss_jump": ("m",),
    "gnss_float": (),
    "ins_off": (),
    "ins_nan": (),
    "left_dead": (),
    "right_dead": (),
    "tool_stops": (),
    "tool_depth": ("m",),
    "line_corrupt": ("line",),
    "line_repeat": ("line",),
    "line_silent": ("line",),
    "bus_off": (),
    "override_stuck": (),
    "override_wire_cut": (),
    "estop_held": (),
    "supply_sag": ("v",),
}
"""Faults by name, and what each must say of itself. ``left_dead``: of the sensor; ``tool_depth``: m deeper."""
