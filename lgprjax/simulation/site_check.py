"""What the parts of a site file must be to each other: refused with its place before anything is rendered."""

from lgprjax.scene import GroundConfig
from lgprjax.simulation.site_limits import LIMITS
from lgprjax.simulation.site_plan import Site, SiteDrive
from lgprjax.simulation.site_table import Place

_WANDERS = 3.0  # rms of the wander that a lane leaves room for


def refuse_impossible(site: Site, root: Place) -> None:
    """Hold sections and drives against each other.

    Raises:
        InputError: a band that the time axis cannot hold, an arc that is too tight, a drive that leaves the road or
            hears beyond the ground, a dead channel that there is none of.
    """
    _check_radar(site, root.at("radar"))
    tightest = 1.0 / site.road.min_radius_m
    for number, (length_m, curvature) in enumerate(site.road.arcs, 1):
        place = root.at("road").at(f"arcs[{number}]")
        if not length_m > 0.0:
            raise place.refuse("[length in metres above 0, curvature per metre]", f"a length of {length_m:g}")
        if abs(curvature) > tightest * (1 + 1e-12):
            limit = f"a curvature of -{tightest:.4g} to {tightest:.4g} per metre (min_radius_m)"
            raise place.refuse(limit, f"{curvature:g}")
    reach = max(abs(site.array.geometry.y_m)) + site.radar.aperture_m
    if reach > site.ground.half_width_m:
        expected = f"{reach:.2f} or more, what array and antennas hear to the side"
        raise root.at("ground").at("half_width_m").refuse(expected, f"{site.ground.half_width_m:g}")
    for number, drive in enumerate(site.drives, 1):
        _check_drive(site, drive, Place(root.file, f"drive[{number}]"))


def _check_radar(site: Site, place: Place) -> None:
    radar, sweeps = site.radar, site.sweeps
    highest = 500.0 / radar.sample_step_ns
    if radar.band_mhz[1] > highest:
        raise place.at("band_mhz").refuse(f"at most {highest:.0f} MHz at this sample_step_ns", f"{radar.band_mhz[1]:g}")
    if 2 * radar.band_edge_mhz > radar.band_mhz[1] - radar.band_mhz[0]:
        expected = f"at most half the band, {0.5 * (radar.band_mhz[1] - radar.band_mhz[0]):g}"
        raise place.at("band_edge_mhz").refuse(expected, f"{radar.band_edge_mhz:g}")
    if sweeps is not None and sweeps.frequency_mhz[-1] > highest:
        last = f"a last frequency of {sweeps.frequency_mhz[-1]:g} MHz"
        raise place.at("sweeps").at("steps").refuse(f"at most {highest:.0f} MHz at this sample_step_ns", last)


def _check_drive(site: Site, drive: SiteDrive, place: Place) -> None:
    plan, ground, array, aperture = drive.plan, site.ground, site.array, site.radar.aperture_m
    if plan.direction == 0:
        raise place.at("direction").refuse("1 or -1", "0")
    if not plan.start_m < plan.stop_m:
        raise place.at("stop_m").refuse(f"more than start_m, {plan.start_m:g}", f"{plan.stop_m:g}")
    # The body must be on the road, and the array, ahead of it one way or the other, must hear ground.
    ahead_m = plan.direction * array.x_m
    least_m = -ground.margin_m + max(0.0, aperture - ahead_m)
    most_m = ground.length_m + ground.margin_m - max(0.0, aperture + ahead_m)
    for key, value in (("start_m", plan.start_m), ("stop_m", plan.stop_m)):
        if not least_m <= value <= most_m:
            why = f"{least_m:g} to {most_m:g}, where road and ground reach as far as the array hears"
            raise place.at(key).refuse(why, f"{value:g}")
    half_array_m = float(max(abs(array.geometry.y_m)))
    room_m = ground.half_width_m - half_array_m - aperture - _WANDERS * plan.wander_m
    if room_m < 0:
        expected = f"less, so that array and antennas ({half_array_m + aperture:.2f} m) hear ground on both sides"
        raise place.at("wander_m").refuse(expected, f"{plan.wander_m:g}")
    if abs(plan.lane_m) > room_m:
        why = f"-{room_m:.2f} to {room_m:.2f}, where array and antennas hear ground on both sides"
        raise place.at("lane_m").refuse(why, f"{plan.lane_m:g}")
    duration_s = (plan.stop_m - plan.start_m) / plan.speed_mps
    if duration_s * array.scan_rate_hz < 2.0:
        raise place.at("stop_m").refuse("two scans or more", f"{duration_s:.3g} s at {array.scan_rate_hz:g} scans a s")
    low, high = LIMITS[GroundConfig]["velocity_m_per_ns"]
    velocity = ground.velocity_m_per_ns * drive.day.velocity_factor
    if not low <= velocity <= high:
        why = f"a velocity in the ground of {low:g} to {high:g} m/ns on that day"
        raise place.at("day").refuse(why, f"{velocity:.3g} m/ns")
    for channel in drive.faults.dead_channels:
        if channel >= array.channels:
            expected = f"dead_channels from 0 to {array.channels - 1}"
            raise place.at("faults").refuse(expected, str(channel))
