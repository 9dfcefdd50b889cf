"""The pictures: which there are, what draws each, and the files that each is drawn from."""

from collections.abc import Callable
from functools import cached_property
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from pictures.demo import DemoSite
    from pictures.fields import SampleField
    from pictures.loop import LoopDrive, OperatorPage

SITE = (
    "pictures/demo.py",
    "sites/village.toml",
    "lgprjax/mapping/*.py",
    "lgprjax/radar/*.py",
    "lgprjax/registration/*.py",
    "lgprjax/scene/*.py",
    "lgprjax/subsurface/*.py",
)
PAGE = ("pictures/loop.py", "lgprjax/runtime/display/page/*", "validation/loops/browsed_page.py")
FIELD = (
    "pictures/fields.py",
    "lgprjax/coverage/*.py",
    "lgprjax/simulation/field_loop.py",
    "lgprjax/report/coverage.py",
)
LOOP = (
    "pictures/loop.py",
    "benchmarks/course_drive.py",
    "lgprjax/autopilot/*.py",
    "lgprjax/navigation/*.py",
    "lgprjax/registration/*.py",
    "lgprjax/simulation/loop/*.py",
    "lgprjax/vehicle/*.py",
)


class Workshop:
    """What several pictures show, made once when first asked for.

    Args:
        folder: for files that are needed while drawing.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    # Imported late: a list of the pictures needs neither JAX nor a browser.

    @cached_property
    def site(self) -> "DemoSite":
        """The demonstration's site."""
        from pictures.demo import DemoSite

        return DemoSite(_made(self.folder / "site"))

    @cached_property
    def field(self) -> "SampleField":
        """The worked field."""
        from pictures.fields import SampleField

        return SampleField()

    @cached_property
    def loop(self) -> "LoopDrive":
        """The drive in closed loop."""
        from pictures.loop import LoopDrive

        return LoopDrive(_made(self.folder / "loop"))

    @cached_property
    def page(self) -> "OperatorPage":
        """The operator's page."""
        from pictures.loop import OperatorPage

        return OperatorPage()


def _made(folder: Path) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    return folder


class Picture(NamedTuple):
    """One picture.

    Attributes:
        draw: writes the file.
        sources: patterns of the files that it is drawn from.
    """

    draw: Callable[[Workshop, Path], None]
    sources: tuple[str, ...]


def _alone(module: str, function: str, *sources: str) -> Picture:
    """A picture that needs no data made beforehand."""

    def draw(_: Workshop, path: Path) -> None:
        getattr(import_module(f"pictures.{module}"), function)(path)

    return Picture(draw, (f"pictures/{module}.py", "pictures/style.py", *sources))


def _of(what: str, module: str, function: str, *sources: str) -> Picture:
    """A picture of something that the workshop makes."""

    def draw(shop: Workshop, path: Path) -> None:
        getattr(import_module(f"pictures.{module}"), function)(getattr(shop, what), path)

    common = {"site": SITE, "field": FIELD, "loop": LOOP, "folder": ()}[what]
    return Picture(draw, (f"pictures/{module}.py", "pictures/style.py", "lgprjax/report/style.py", *common, *sources))


def _display(name: str) -> Picture:
    def draw(shop: Workshop, path: Path) -> None:
        from pictures.loop import draw_display

        draw_display(shop.page, name, path)

    return Picture(draw, PAGE)


def _closed_loop(shop: Workshop, path: Path) -> None:
    from pictures.loop import draw_closed_loop

    draw_closed_loop(shop.loop, shop.page, path)


def _record(shop: Workshop, path: Path) -> None:
    from pictures.loop import draw_record

    draw_record(shop.site, shop.page, path)


PICTURES: dict[str, Picture] = {
    "hero.webp": _of("site", "moving", "draw_hero"),
    "evidence.webp": _of("site", "moving", "draw_evidence"),
    "system.svg": _alone("parts", "draw_system"),
    "pipeline.svg": _alone("parts", "draw_pipeline"),
    "data-flow.svg": _alone("parts", "draw_data_flow"),
    "fix-codes.svg": _alone("parts", "draw_fix_codes", "lgprjax/registration/fix.py", "lgprjax/registration/judge.py"),
    "modes.svg": _alone("parts", "draw_modes", "lgprjax/autopilot/modes.py"),
    "onboard-processes.svg": _alone("parts", "draw_onboard_processes"),
    "how-it-works.svg": _alone("geometry", "draw_how_it_works"),
    "coordinate-frames.svg": _alone("geometry", "draw_coordinate_frames"),
    "vehicle-geometry.svg": _alone("geometry", "draw_vehicle_geometry"),
    "skid-geometry.svg": _alone("geometry", "draw_skid_geometry"),
    "array-layout.svg": _alone("geometry", "draw_array_layout"),
    "swath-geometry.svg": _alone("geometry", "draw_swath_geometry"),
    "accuracy-weather.png": _alone("records", "draw_accuracy_weather", "docs/records/closed-loop.json"),
    "accuracy-real.png": _alone("records", "draw_accuracy_real", "docs/records/real.json"),
    "accuracy-calibration.png": _alone("records", "draw_accuracy_calibration", "docs/records/worlds.json"),
    "radargram.png": _alone("reports", "draw_radargram", "lgprjax/report/radargram.py", "lgprjax/report/style.py"),
    "time-scale.png": _of("site", "records", "draw_time_scale"),
    "slices.png": _of("site", "reports", "draw_slices", "lgprjax/report/radargram.py"),
    "match.png": _of("site", "reports", "draw_match", "lgprjax/report/match.py"),
    "match-over-position.png": _of("site", "reports", "draw_match_over_position", "lgprjax/report/match.py"),
    "swarm.png": _of("site", "reports", "draw_swarm", "lgprjax/report/match.py", "lgprjax/pso/*.py"),
    "trajectory.png": _of("site", "reports", "draw_wet_trajectory", "lgprjax/report/drive.py"),
    "demo-trajectory.png": _of("site", "reports", "draw_live_trajectory", "lgprjax/report/drive.py"),
    "confidence.png": _of("site", "reports", "draw_live_confidence", "lgprjax/report/drive.py"),
    "ground.png": _of("site", "reports", "draw_ground", "lgprjax/report/map.py"),
    "map-verify.png": _of("site", "reports", "draw_map_verify", "lgprjax/report/map.py"),
    "look-ahead.png": _of(
        "folder",
        "reports",
        "draw_look_ahead",
        "lgprjax/report/motion_pictures.py",
        "lgprjax/tuning/look_ahead.py",
        "tuning/look_ahead.toml",
        "tuning/tuned.vehicle.toml",
    ),
    "field-coverage.png": _of("field", "fields", "draw_field_coverage"),
    "worked-probability.png": _of("field", "fields", "draw_worked_probability"),
    "driven-course.png": _of("loop", "loop", "draw_course", "lgprjax/report/drive.py"),
    "closed-loop.png": Picture(_closed_loop, (*LOOP, *PAGE)),
    "display-record.png": Picture(_record, (*SITE, *PAGE, "lgprjax/runtime/radargram.py")),
    **{f"display-{name}.png": _display(name) for name in ("day", "night", "error", "field", "calibrate")},
}
"""Every picture that ``make pictures`` draws, by the name of its file."""

MEASURED = {
    "timing.png": "python -m benchmarks runtime --figure docs/pictures/timing.png --force",
    "search-success.png": "python -m benchmarks registration --figure docs/pictures/search-success.png --force",
}
"""Pictures of measurements, whose times differ from run to run, and the commands that measure and draw them."""

BROWSED = frozenset({"closed-loop.png", *(name for name in PICTURES if name.startswith("display-"))})
"""Pictures with the operator's page: a browser paints a pixel of a corner a shade darker or lighter from run to run. A
picture that differs by no more than that is kept."""
