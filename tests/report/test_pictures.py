"""Pictures: written whole, from any drive, and showing what the records say."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.image import imread
from matplotlib.patches import Ellipse

from lgprjax.errors import InputError
from lgprjax.report import DriveResult, draw_codes, draw_match, draw_surface, draw_trajectory
from lgprjax.report.drive import plan_frame, reference_track
from report.synthetic import correlation_surface, declined_drive, match_example, straight_drive, without_truth


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
    "truth": straight_drive,
    "heading": lambda: straight_drive(yaw_rad=straight_drive().heading_rad),
    "no truth": without_truth,
    "declined": declined_drive,
    "ring": closed_loop,
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


@pytest.mark.parametrize("drive", DRIVES.values(), ids=DRIVES.keys())
def test_any_drive_draws(drive: Callable[[], DriveResult], tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    draw_trajectory(drive(), tmp_path / "a.png")
    assert imread(tmp_path / "a.png").std() > 0.01
    assert [p.name for p in tmp_path.iterdir()] == ["a.png"]
    # matplotlib logs what it could not do as asked, where others would warn.
    assert not caplog.records


def test_codes_of_all_kinds_of_drives_draw(tmp_path: Path) -> None:
    drives = [drive() for drive in DRIVES.values()]
    draw_codes(drives, tmp_path / "c.png", risks=[1e-3] * len(drives))
    draw_codes_of(DRIVES["nothing tried"](), tmp_path / "d.png")
    assert all(imread(tmp_path / name).std() > 0.01 for name in ("c.png", "d.png"))


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
    assert float(difference.get_title(loc="left").split("r = ")[1]) > 0.9
    assert abs(float(difference_beside.get_title(loc="left").split("r = ")[1])) < 0.4
    caption = drawn[0].get_supxlabel()
    assert example.gain in caption
    assert "Depth drawn ×1." in caption.replace("\n", " ")


def test_silent_match_draws(tmp_path: Path) -> None:
    example = match_example()
    silence = np.zeros_like(example.live)
    gaps = np.where(np.arange(silence.shape[1]) % 7, example.beside, np.nan)
    draw_match(replace(example, live=silence, baseline=silence, beside=gaps, window_m=None), tmp_path / "m.png")


def test_surface_keeps_its_scale_and_puts_x_across(tmp_path: Path, drawn: list[Figure]) -> None:
    surface = correlation_surface()
    draw_surface(surface, tmp_path / "s.png")
    axes = drawn[0].axes[0]
    image = axes.images[0]
    assert image.get_clim() == (0.0, 1.0)
    assert np.asarray(image.get_array()).shape == (len(surface.y_m), len(surface.x_m))
    assert image.get_extent() == pytest.approx((-2.025, 2.025, -1.525, 1.525))
    assert (axes.get_xlabel(), axes.get_ylabel(), axes.get_aspect()) == ("along (m)", "cross (m)", 1.0)
    assert "0.028 m" in drawn[0].get_supxlabel()


def test_surface_without_rival_truth_or_map_draws(tmp_path: Path) -> None:
    surface = correlation_surface()
    draw_surface(replace(surface, second=None, truth=None), tmp_path / "a.png")
    draw_surface(replace(surface, correlation=np.full_like(surface.correlation, np.nan)), tmp_path / "b.png")


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
        blind = next(line for line in plan.lines if line.get_label() == "ok fixes, no truth")
        judged = np.asarray(plan.collections[-1].get_offsets())
        assert len(np.asarray(blind.get_xdata())) == drive.ok[:first].sum()
        assert len(judged) == drive.ok[first:].sum()
        said = drawn[-1].get_supxlabel().replace("\n", " ")
        assert f"No truth is known for {drive.ok[:first].sum()} of the ok fixes" in said
    texts = [text.get_text() for text in panel_of(drawn[-1], "cross-track").texts]
    assert texts == ["no truth is known for the ok fixes"]
    # The plan follows the road, of which the truth shows a few metres.
    assert plan_frame(reference_track(known_from(395))).along_road


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
    truth, prior, ring = ((figure.get_supxlabel().replace("\n", " "), figure) for figure in drawn)
    plan = truth[1].axes[0]
    box = plan.get_window_extent()
    metre_across, metre_along = box.height / np.ptp(plan.get_ylim()), box.width / np.ptp(plan.get_xlim())
    assert f"across drawn ×{metre_across / metre_along:.1f}" in truth[0]
    assert "error" in panel_of(truth[1], "cross-track").get_ylabel()
    assert "fix − prior" in panel_of(prior[1], "cross-track").get_ylabel()
    assert "not errors" in prior[0]
    assert "equal aspect" in ring[0]
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


def test_plan_of_a_straight_road_runs_ahead_and_left() -> None:
    frame = plan_frame(np.array([[0.0, 0.0], [-3.0, 0.01], [-6.0, 0.0]]))
    along, cross = frame(np.array([-6.0]), np.array([-2.0]))
    assert frame.along_road
    # Driving west: six metres ahead, and south is to the left.
    assert along[0] == pytest.approx(6.0, abs=0.01)
    assert cross[0] == pytest.approx(2.0, abs=0.02)
    assert not plan_frame(reference_track(closed_loop())).along_road


def test_codes_draws_the_risk_and_shares(tmp_path: Path, drawn: list[Figure]) -> None:
    drives = [straight_drive(), declined_drive()]
    draw_codes(drives, tmp_path / "c.png", risks=[1e-3] * len(drives))
    evidence, margin, bar = drawn[0].axes[:3]
    assert evidence.lines[0].get_xdata()[0] == pytest.approx(3.0)  # type: ignore[index]
    # What a lead must be differs from fix to fix: there is no line for all.
    assert not margin.lines
    widths = [patch.get_width() for patch in bar.patches]  # type: ignore[attr-defined]
    assert sum(widths) == pytest.approx(100.0)
    assert widths[0] == pytest.approx(100.0 * drives[0].ok.mean())
    assert any("the risk, 0.001." in text.get_text() for text in drawn[0].texts)
    assert "(impostor): 0 ok of 200 tried" in drawn[0].axes[3].get_title(loc="left")


def test_each_drive_is_drawn_with_its_own_risk(tmp_path: Path, drawn: list[Figure]) -> None:
    draw_codes([straight_drive(), straight_drive(), straight_drive()], tmp_path / "c.png", risks=[1e-3, 1e-5, None])
    lines = [drawn[0].axes[3 * row].lines for row in range(3)]
    assert [line[0].get_xdata()[0] for line in lines[:2]] == pytest.approx([3.0, 5.0])  # type: ignore[index]
    assert not lines[2]
    assert any("the risk of each drive's search." in text.get_text().replace("\n", " ") for text in drawn[0].texts)


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
        with pytest.raises(InputError, match="one that exists"):
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
    said = [figure.get_supxlabel().replace("\n", " ") for figure in drawn]
    assert "GNSS/INS silent for a second" in said[0]
    assert "GNSS" not in said[1]


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


def test_prior_lies_as_its_sigmas_do(tmp_path: Path, drawn: list[Figure]) -> None:
    draw_surface(replace(correlation_surface(), prior_tilt_rad=float(np.radians(30.0))), tmp_path / "s.png")
    ellipses = [patch for patch in drawn[0].axes[0].patches if isinstance(patch, Ellipse)]
    assert [(patch.width, patch.height) for patch in ellipses] == [(1.0, 0.6), pytest.approx((3.0, 1.8))]
    assert [patch.angle for patch in ellipses] == pytest.approx([30.0, 30.0])
