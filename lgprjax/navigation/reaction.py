"""What a fault of the navigation asks of the vehicle, and the faults that are told apart."""

from enum import IntEnum, IntFlag


class Reaction(IntEnum):
    """What the vehicle is to do; the larger one wins."""

    CONTINUE = 0
    DEGRADE = 1
    """Drive on below the speed cap."""
    STOP = 2
    """Controlled stop: throttle idle, ramped brake, steer on along the last valid local path."""


class Reason(IntFlag):
    """Why. Several may hold at once; the order of the bits is that of the rules in ``health``."""

    NON_FINITE = 1
    """The estimate holds a number that is none."""
    BAD_STEP = 2
    """The clock stood, went back or leapt."""
    GNSS_SILENT = 4
    GNSS_STUCK = 8
    """The receiver repeats one position while the vehicle moves."""
    GNSS_COARSE = 16
    """The receiver itself reports a large error: float or single instead of fixed."""
    GNSS_REJECTED = 32
    HEADING_SILENT = 64
    HEADING_REJECTED = 128
    ODOMETER_SILENT = 256
    ODOMETER_REJECTED = 512
    LGPR_SILENT = 1024
    LGPR_REJECTED = 2048
    LGPR_FADED = 4096
    """The scans match the map ever less: wet soil, frost, or a stretch that has changed."""
    CONFLICT = 8192
    """GNSS and LGPR say different places, both with confidence."""
    REACQUIRED = 16384
    """A source that had been rejected was taken back, because the filter itself must have been wrong."""
    FRAME_BEHIND = 32768
    """The path in the local frame has yet to be moved to where it belongs."""
    UNCERTAIN = 65536
    """The cross-track error that the filter owns to is large."""
    POSITION_LOST = 131072
    """Neither GNSS nor LGPR: dead reckoning. Asks for a stop."""
    HEADING_LOST = 262144
    """No heading and no fix that would give one. Asks for a stop."""
    SPEED_LOST = 524288
    """The speed is not known. Asks for a stop."""
    CONFLICT_LASTS = 1048576
    """The conflict has lasted. Asks for a stop."""
    FRAME_FAR = 2097152
    """The path is too far from where it belongs. Asks for a stop."""
    TOO_UNCERTAIN = 4194304
    """The cross-track error exceeds the budget. Asks for a stop."""


STOPPING = (
    Reason.NON_FINITE
    | Reason.POSITION_LOST
    | Reason.HEADING_LOST
    | Reason.SPEED_LOST
    | Reason.CONFLICT_LASTS
    | Reason.FRAME_FAR
    | Reason.TOO_UNCERTAIN
)
"""Reasons that ask for a stop; the others degrade."""
