"""Pictures: written whole, from any drive, and showing what the records say."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Ellipse

from lgprjax.report import DriveResult, draw_codes, draw_match, draw_surface, draw_trajectory
from lgprjax.report.drive import plan_frame, reference_track
from refusals import refused
from report.synthetic import correlation_surface, declined_drive, match_example, numbers, straight_drive, without_truth


def draw_codes_of(result: DriveResult, path: Path, *, force: bool = False) -> None:
    draw_codes([result], path, risks=[1e-4], force=force)


def closed_loop() -> DriveResult:
    """A ring road: no axis to stretch along."""
    angle = np.linspace(0.0, 6.0, 300)
    east, north = 100.0 * np.cos(angle), 80.0 * np.sin(angle)
    return straight_drive(300, truth_east_m=east, truth_north_m=north, east_m=east + 0.02, north_m=north)


def windowed() -> DriveResult:
    """Fixes on every tenth scan, as windows leave them."""
    drive = straight_drive(400)
    return replace(drive, code=np.where(np.arange(400) % 10 == 9, drive.code, "no_window"))


STILL, NAN = np.zeros(30), np.full(30, np.nan)
DRIVES: dict[str, Callable[[], DriveResult]] = {
    "heading": lambda: straight_drive(yaw_rad=straight_drive().heading_rad),
    "windows": windowed,
    "single scan": lambda: straight_drive(1),
    "single declined scan": lambda: declined_drive(1),
    "nothing tried": lambda: straight_drive(30, code=np.full(30, "no_window")),
    "standing": lambda: replace(
        straight_drive(30), distance_m=STILL, truth_east_m=STILL, truth_north_m=STILL, east_m=STILL, north_m=STILL
    ),
    "no finite number": lambda: replace(
        declined_drive(30), correlation=NAN, margin=NAN, sigma_along_m=NAN, prior_east_m=NAN, distance_m=NAN
    ),
}


def test_any_drive_draws(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    for name, drive in DRIVES.items():
        draw_trajectory(drive(), tmp_path / f"{name}.png")
    draw_codes([drive() for drive in DRIVES.values()], tmp_path / "codes.png", risks=[1e-3] * len(DRIVES))
    draw_codes_of(DRIVES["nothing tried"](), tmp_path / "none.png")
    assert {path.stem for path in tmp_path.iterdir()} == {*DRIVES, "codes", "none"}
    # matplotlib logs what it could not do as asked, where others would warn.
    assert not caplog.records


def test_match_shows_the_strips_and_their_difference_at_one_scale(tmp_path: Path, drawn: list[Figure]) -> None:
    example = match_example()
    draw_match(example, tmp_path / "m.png")
    panels = [axes for axes in drawn[0].axes if axes.images]
    map_here, map_beside, live, _, difference, difference_beside = panels
    np.testing.assert_array_equal(np.asarray(map_here.images[0].get_array()), example.baseline.T)
    np.testing.assert_array_equal(np.asarray(map_beside.images[0].get_array()), example.beside.T)
    np.testing.assert_allclose(np.asarray(difference.images[0].get_array()), (example.live - example.baseline).T)
    limits = {panel.images[0].get_clim() for panel in panels}
    assert len(limits) == 1
    low, high = limits.pop()
    assert low == -high
    top, bottom = live.get_ylim()[::-1]
    assert top < bottom, "time zero stands at the top"
    # r is high at the place and low beside it; the titles must say which is which.
    assert float(numbers(difference.get_title(loc="left"))[-1]) > 0.9
    assert float(numbers(difference_beside.get_title(loc="left"))[-1]) < 0.4
    assert example.gain in drawn[0].get_supxlabel()


def test_surface_keeps_its_scale_and_puts_x_across(tmp_path: Path, drawn: list[Figure]) -> None:
    surface = replace(correlation_surface(), prior_tilt_rad=float(np.radians(30.0)))
    draw_surface(surface, tmp_path / "s.png")
    axes = drawn[0].axes[0]
    ellipses = [patch for patch in axes.patches if isinstance(patch, Ellipse)]
    assert [(patch.width, patch.height) for patch in ellipses] == [(1.0, 0.6), pytest.approx((3.0, 1.8))]
    assert [patch.angle for patch in ellipses] == pytest.approx([30.0, 30.0])
    image = axes.images[0]
    assert image.get_clim() == (0.0, 1.0)
    assert np.asarray(image.get_array()).shape == (len(surface.y_m), len(surface.x_m))
    assert image.get_extent() == pytest.approx((-2.025, 2.025, -1.525, 1.525))
    assert (axes.get_xlabel(), axes.get_ylabel(), axes.get_aspect()) == ("along (m)", "cross (m)", 1.0)
    assert "0.028" in drawn[0].get_supxlabel()
    # Without a rival, truth or map there is a picture too.
    empty = np.full_like(surface.correlation, np.nan)
    draw_surface(replace(surface, second=None, truth=None, correlation=empty), tmp_path / "b.png")


def test_codes_draw_the_risk_of_each_drive_and_shares(tmp_path: Path, drawn: list[Figure]) -> None:
    drives = [straight_drive(), declined_drive(), straight_drive()]
    draw_codes(drives, tmp_path / "c.png", risks=[1e-3, 1e-5, None])
    rows = [drawn[0].axes[3 * row : 3 * row + 3] for row in range(3)]
    assert [row[0].lines[0].get_xdata()[0] for row in rows[:2]] == pytest.approx([3.0, 5.0])  # type: ignore[index]
    assert not rows[2][0].lines
    # What a lead must be differs from fix to fix: there is no line for all.
    assert not rows[0][1].lines
    widths = [patch.get_width() for patch in rows[0][2].patches]  # type: ignore[attr-defined]
    assert sum(widths) == pytest.approx(100.0)
    assert widths[0] == pytest.approx(100.0 * drives[0].ok.mean())
    assert {"0", "200"} <= set(numbers(rows[1][0].get_title(loc="left")))


def panel_of(figure: Figure, word: str) -> Axes:
    return next(axes for axes in figure.axes if axes.get_ylabel().startswith(word))


def known_from(first: int) -> DriveResult:
    """The drive with its truth from a scan on."""
    drive = straight_drive()
    late = np.arange(len(drive.code)) >= first
    assert drive.truth_east_m is not None
    assert drive.truth_north_m is not None
    assert drive.truth_yaw_rad is not None
    return replace(
        drive,
        truth_east_m=np.where(late, drive.truth_east_m, np.nan),
        truth_north_m=np.where(late, drive.truth_north_m, np.nan),
        truth_yaw_rad=np.where(late, drive.truth_yaw_rad, np.nan),
    )


def test_ok_fixes_without_truth_are_seen_as_such(tmp_path: Path, drawn: list[Figure]) -> None:
    # At the end of the drive there are no ok fixes.
    for name, first in (("some", 300), ("none", 395)):
        drive = known_from(first)
        draw_trajectory(drive, tmp_path / f"{name}.png")
        plan = drawn[-1].axes[0]
        blind = next(line for line in plan.lines if line.get_label() == "ok fixes, true pose unknown")
        judged = np.asarray(plan.collections[-1].get_offsets())
        assert len(np.asarray(blind.get_xdata())) == drive.ok[:first].sum()
        assert len(judged) == drive.ok[first:].sum()
        assert str(drive.ok[:first].sum()) in drawn[-1].get_supxlabel()
    assert len(panel_of(drawn[-1], "cross-track").texts) == 1
    # The plan follows the road, of which the truth shows a few metres; a ring has no axis.
    assert plan_frame(reference_track(known_from(395))).along_road
    assert not plan_frame(reference_track(closed_loop())).along_road
    # Driving west: six metres ahead, and south is to the left.
    frame = plan_frame(np.array([[0.0, 0.0], [-3.0, 0.01], [-6.0, 0.0]]))
    assert np.ravel(frame(np.array([-6.0]), np.array([-2.0]))) == pytest.approx([6.0, 2.0], abs=0.02)


def test_trajectory_shows_every_ok_fix_however_wrong(tmp_path: Path, drawn: list[Figure]) -> None:
    drive = straight_drive()
    east = drive.east_m.copy()
    east[5] += 4.0
    draw_trajectory(replace(drive, east_m=east), tmp_path / "t.png")
    low, high = panel_of(drawn[0], "cross-track").get_ylim()
    assert low < -4.0 * np.sin(np.radians(40.0)) + 0.3
    assert high == -low


def test_trajectory_states_what_it_stretches_and_what_it_compares_with(tmp_path: Path, drawn: list[Figure]) -> None:
    draw_trajectory(straight_drive(), tmp_path / "a.png")
    draw_trajectory(without_truth(), tmp_path / "b.png")
    draw_trajectory(closed_loop(), tmp_path / "c.png")
    truth, prior, ring = ((figure.get_supxlabel(), figure) for figure in drawn)
    plan = truth[1].axes[0]
    box = plan.get_window_extent()
    metre_across, metre_along = box.height / np.ptp(plan.get_ylim()), box.width / np.ptp(plan.get_xlim())
    assert f"×{metre_across / metre_along:.1f}" in truth[0]
    assert "×" not in ring[0]
    assert panel_of(truth[1], "cross-track").get_ylabel() != panel_of(prior[1], "cross-track").get_ylabel()
    assert plan.get_aspect() == "auto"
    assert ring[1].axes[0].get_aspect() == 1.0


def test_trajectory_shades_what_was_tried_in_vain(tmp_path: Path, drawn: list[Figure]) -> None:
    scans = 11
    code = np.full(scans, "ok", dtype="<U16")
    code[3:5], code[8], code[10] = "edge", "no_window", "ambiguous"
    draw_trajectory(straight_drive(scans, code=code, distance_m=np.arange(11.0)), tmp_path / "t.png")
    axes = panel_of(drawn[0], "correlation")
    shades = [c for c in axes.collections if c.get_label() != "_" and len(c.get_paths()) == 2]
    spans = [tuple(path.get_extents().intervalx) for path in shades[-1].get_paths()]
    assert spans == [(2.5, 4.5), (9.5, 10.0)]


def test_existing_picture_is_refused_without_force(tmp_path: Path) -> None:
    target = tmp_path / "x.png"
    target.write_bytes(b"mine")
    calls: list[Callable[[bool], None]] = [
        lambda force: draw_match(match_example(), target, force=force),
        lambda force: draw_surface(correlation_surface(), target, force=force),
        lambda force: draw_trajectory(straight_drive(), target, force=force),
        lambda force: draw_codes_of(straight_drive(), target, force=force),
    ]
    for call in calls:
        with refused("output", "--force", file="x.png"):
            call(False)
    assert target.read_bytes() == b"mine"
    calls[1](True)
    assert target.read_bytes()[:4] == b"\x89PNG"


def test_drawing_leaves_the_settings_as_they_were(tmp_path: Path) -> None:
    before = dict(mpl.rcParams)
    draw_surface(correlation_surface(), tmp_path / "s.png")
    assert dict(mpl.rcParams) == before


def test_trajectory_hatches_where_there_was_no_gnss(tmp_path: Path, drawn: list[Figure]) -> None:
    gap = np.zeros(11, bool)
    gap[2:5] = gap[9] = True
    drive = straight_drive(11, distance_m=np.arange(11.0), gnss_gap=gap)
    draw_trajectory(drive, tmp_path / "a.png")
    draw_trajectory(replace(drive, gnss_gap=np.zeros(11, bool)), tmp_path / "b.png")
    for word in ("cross-track", "along-track", "correlation"):
        (hatched,) = [c for c in panel_of(drawn[0], word).collections if c.get_hatch()]
        spans = [tuple(path.get_extents().intervalx) for path in hatched.get_paths()]
        assert spans == [(1.5, 4.5), (8.5, 9.5)]
        assert not any(c.get_hatch() for c in panel_of(drawn[1], word).collections)
    assert drawn[0].get_supxlabel() != drawn[1].get_supxlabel()


def test_heading_error_stands_in_the_bands_that_the_fixes_state(tmp_path: Path, drawn: list[Figure]) -> None:
    drive = straight_drive(yaw_rad=straight_drive().heading_rad)
    sigma = np.full(len(drive.code), np.radians(0.3))
    draw_trajectory(replace(drive, sigma_yaw_rad=sigma), tmp_path / "t.png")
    axes = panel_of(drawn[0], "heading")
    wide, narrow = axes.collections[:2]
    for band, limit_deg in ((wide, 0.9), (narrow, 0.3)):
        box = band.get_paths()[0].get_extents()
        assert (box.ymin, box.ymax) == pytest.approx((-limit_deg, limit_deg))
    low, high = axes.get_ylim()
    assert high == -low > 0.9
