"""Handover of a record of a worked field: GIS layers, turning points, and a report to be signed."""

import math
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from lgprjax.errors import ArgumentError, InputError
from lgprjax.files import file_hash
from lgprjax.formats import (
    WorkedRecord,
    stop_words,
    write_cells,
    write_geojson,
    write_geopackage,
    write_kml,
    write_shapefiles,
    write_turning_points,
)
from lgprjax.report.coverage import (
    COLOURS,
    CoveragePage,
    CoverChannelsPicture,
    CoverPicture,
    draw_cover_channels,
    draw_coverage,
    level_colours,
    write_coverage_page,
)
from lgprjax.report.html import ReportFigure
from lgprjax.worked.evidence import residual_of, shared_error_lines
from lgprjax.worked.layers import (
    STATUS,
    CoverFigures,
    cover_figures,
    cover_layers,
    driver_of_pass,
    evidence_of,
    inside_of,
    layer_name,
    method_of,
    percent,
    square_metres,
    told_of_work,
    tool_measured,
    utc_of,
    way_by_driver,
)

_RECORD = ".worked.h5"
_SUFFIXES = (".gpkg", ".geojson", ".kml", ".shp.zip", ".cells.csv", ".turning_points.csv", ".html")


def handover_files(
    path: Path, folder: Path, benchmark_deg: tuple[float, float] | None, *, force: bool
) -> tuple[Path, ...]:
    """The files that ``hand_over`` writes, with all checks that do not need the work.

    Raises:
        InputError: the benchmark is not a position, or a file exists (without ``force``).
    """
    mark = benchmark_deg
    if mark is not None and not (abs(mark[0]) <= 90.0 and abs(mark[1]) <= 180.0):
        raise ArgumentError(
            "benchmark_deg", "a latitude from -90 to 90 and a longitude from -180 to 180", f"{mark[0]:g} {mark[1]:g}"
        )
    if folder.exists() and not folder.is_dir():
        raise InputError(folder, "output", "a folder", "a file")
    stem = path.name.removesuffix(_RECORD)
    outputs = tuple(folder / f"{stem}{suffix}" for suffix in _SUFFIXES)
    for output in outputs:
        if output.exists() and not force:
            raise InputError(output, "output", "a new file, or --force", "an existing file")
    return outputs


def hand_over(
    path: Path,
    record: WorkedRecord,
    folder: Path,
    *,
    organisation: str = "not stated",
    benchmark_deg: tuple[float, float] | None = None,
    force: bool = False,
) -> tuple[Path, ...]:
    """Write a record as GeoPackage, GeoJSON, KML, shapefiles, cells and turning points as CSV, and a report.

    Returns the files.

    Args:
        path: file of the record, whose hash the files state.
        record: contents of the record.
        folder: folder of the files, created if missing.
        organisation: responsible organisation, named in every shape and in the report.
        benchmark_deg: latitude and longitude of a marked point, the origin of bearings and distances; by default the
            first corner.
        force: whether to replace existing files.

    Raises:
        InputError: as ``handover_files``, or a file cannot be written.
    """
    outputs = handover_files(path, folder, benchmark_deg, force=force)
    package, collection, markup, shapes, cells, table, page = outputs
    layers = cover_layers(record, organisation)
    folder.mkdir(parents=True, exist_ok=True)
    metadata = _metadata(path, record, organisation)
    write_geopackage(package, layers, metadata, force=force)
    write_geojson(collection, layers, metadata, force=force)
    write_kml(markup, layers, metadata, colours=_colours(record), force=force)
    write_shapefiles(shapes, layers, force=force)
    write_cells(cells, record, inside_of(record), force=force)
    latitude, longitude = _corners(record)
    write_turning_points(table, latitude, longitude, benchmark_deg, force=force)
    _write_page(page, path, record, cover_figures(record), organisation, force)
    return outputs


def _metadata(path: Path, record: WorkedRecord, organisation: str) -> dict[str, str]:
    return {
        "field": record.name,
        "organisation": organisation,
        "method": method_of(record),
        "status": STATUS,
        **told_of_work(record),
        "datum": "WGS 84",
        "record": path.name,
        "record_sha256": file_hash(path),
        "plan_sha256": ", ".join(str(plan["sha256"]) for plan in _plans(record)[:1]) or "none",
        "note": "A machine pass is not clearance. Processed ground consists of the cells at the given level only.",
    }


def _colours(record: WorkedRecord) -> dict[str, str]:
    levels = record.cells.level.tolist()
    names = map(layer_name, levels)
    return {**dict(zip(names, level_colours(len(levels)), strict=True)), "gaps": COLOURS[0]}


def _corners(record: WorkedRecord) -> tuple[np.ndarray, np.ndarray]:
    corners = record.perimeter_m
    latitude, longitude, _ = record.frame.to_geodetic(corners[:, 0], corners[:, 1], np.zeros(len(corners)))
    return latitude, longitude


def _write_page(
    path: Path, source: Path, record: WorkedRecord, figures: CoverFigures, organisation: str, force: bool
) -> None:
    passes, stops, runs = record.passes, record.stops, record.provenance["runs"]
    time_s = record.channels.time_s
    latitude, longitude = _corners(record)
    evidence = evidence_of(record)
    facts = (
        *((name.replace("_", " "), value) for name, value in told_of_work(record).items()),
        ("method", method_of(record)),
        ("vehicle", str(record.provenance["vehicle"]["name"])),
        ("tool", f"{record.tool.width_m:g} m wide, {record.tool.length_m:g} m long"),
        ("field", square_metres(figures.area_m2)),
        ("passes", f"{figures.passes}, {figures.way_m:.0f} m"),
        ("depth, mean and least", f"{_centimetres(figures.depth_mean_m)}, {_centimetres(figures.depth_least_m)}"),
        ("runs", ", ".join(f"{run['folder']}{'' if run['complete'] else ' (incomplete)'}" for run in runs)),
        ("fixed GNSS position", f"{100.0 * figures.fixed:.1f} % of the time"),
        *(("driven", f"{words}: {way_m:.0f} m") for words, way_m in way_by_driver(record).items()),
        *shared_error_lines(evidence),
    )
    rows = [
        (
            str(number + 1),
            str(runs[int(passes.run[number])]["folder"]),
            driver_of_pass(record, number),
            str(int(passes.line[number]) + 1) if passes.line[number] >= 0 else "",
            _clock(record, float(passes.begin_s[number])),
            f"{passes.length_m[number]:.1f}",
            _depths(float(passes.depth_mean_m[number]), float(passes.depth_least_m[number])),
            f"{passes.speed_mean_mps[number]:.2f} / {passes.speed_largest_mps[number]:.2f}",
        )
        for number in range(len(passes.run))
    ]
    with tempfile.TemporaryDirectory(dir=path.parent, prefix=".export-") as folder:
        page = CoveragePage(
            name=record.name,
            organisation=organisation,
            period=f"{_clock(record, float(time_s.min()))} to {_clock(record, float(time_s.max()))} UTC",
            sentences=tuple(layer.sentence for layer in figures.layers),
            facts=facts,
            layers=tuple(
                (
                    f"{100.0 * layer.level:g} %",
                    *(square_metres(each) for each in (layer.processed_m2, layer.uncertain_m2, layer.not_processed_m2)),
                    percent(layer.share),
                )
                for layer in figures.layers
            ),
            passes_header=(
                "pass",
                "run",
                "driven",
                "line",
                "begin (UTC)",
                "length m",
                "depth cm, mean / least",
                "m/s, mean / most",
            ),
            passes=tuple(rows),
            stops=tuple(
                (
                    str(runs[int(stops.run[number])]["folder"]),
                    _clock(record, float(stops.begin_s[number])),
                    f"{stops.end_s[number] - stops.begin_s[number]:.1f} s",
                    stop_words(int(stops.reasons[number])),
                )
                for number in range(len(stops.run))
            ),
            finds=tuple(
                (str(each["kind"]), *_place_and_time(each), str(each["note"])) for each in evidence.get("find", [])
            ),
            control_points=tuple(
                (str(each["name"]), str(each["when"]), str(each["run"] or "all"), *_measured(each))
                for each in evidence.get("control_point", [])
            ),
            turning_points=tuple(
                (f"TP{number + 1}", f"{one:.9f}", f"{other:.9f}")
                for number, (one, other) in enumerate(zip(latitude, longitude, strict=True))
            ),
            hashes=_hashes(source, record),
            measured=tool_measured(record),
            figures=_pictures(Path(folder), record),
        )
        write_coverage_page(path, page, force=force)


def _place_and_time(find: dict[str, Any]) -> tuple[str, str, str]:
    time = str(find["time_utc"])[:19].replace("T", " ")
    return time, f"{find['latitude_deg']:.8f}", f"{find['longitude_deg']:.8f}"


def _measured(point: dict[str, Any]) -> tuple[str, str]:
    east, north = residual_of(point)
    return f"{100.0 * east:.1f}", f"{100.0 * north:.1f}"


def _clock(record: WorkedRecord, time_s: float) -> str:
    return utc_of(record, time_s)[:19].replace("T", " ")


def _depths(mean_m: float, least_m: float) -> str:
    return f"{100.0 * mean_m:.1f} / {100.0 * least_m:.1f}" if math.isfinite(mean_m) else "not measured"


def _centimetres(depth_m: float | None) -> str:
    return "none" if depth_m is None else f"{100.0 * depth_m:.1f} cm"


def _plans(record: WorkedRecord) -> list[dict[str, Any]]:
    """Plans that runs were driven by; of ground worked without one none."""
    first = record.provenance["plan"]
    return [*([first] if first else []), *record.provenance["other_plans"]]


def _hashes(source: Path, record: WorkedRecord) -> tuple[tuple[str, str], ...]:
    return (
        (source.name, file_hash(source)),
        *((str(plan["file"]), str(plan["sha256"])) for plan in _plans(record)),
        *(
            (f"{run['folder']}/{segment['file']}", str(segment["sha256"]))
            for run in record.provenance["runs"]
            for segment in run["segments"]
        ),
    )


def cover_picture(record: WorkedRecord) -> CoverPicture:
    """Contents of the map of a record."""
    cells, swaths, stops = record.cells, record.swaths, record.stops
    ways = [swaths.number == number for number in range(len(record.passes.run))]
    return CoverPicture(
        name=record.name,
        perimeter_m=record.perimeter_m,
        east_m=cells.east_m,
        north_m=cells.north_m,
        cell_m=cells.cell_m,
        inside=inside_of(record),
        levels=tuple(cells.level.tolist()),
        states=cells.state,
        swaths_m=tuple(np.stack([swaths.east_m[of], swaths.north_m[of]], axis=1) for of in ways),
        stops_m=np.stack([stops.east_m, stops.north_m], axis=1),
    )


def _pictures(folder: Path, record: WorkedRecord) -> tuple[ReportFigure, ...]:
    channels = record.channels
    position = np.nan_to_num(channels.covariance[:, :2, :2].astype(np.float64))
    measured = CoverChannelsPicture(
        time_s=channels.time_s,
        depth_m=channels.depth_m.astype(np.float64),
        speed_mps=channels.speed_mps.astype(np.float64),
        sigma_m=np.sqrt(np.clip(np.linalg.eigvalsh(position)[:, 1], 0.0, None)),
        counts=(channels.tool & 8) != 0,
        fixed=channels.gnss_quality == 3,
        stopped=channels.stop != 0,
    )
    draw_coverage(cover_picture(record), folder / "map.png")
    draw_cover_channels(measured, folder / "channels.png")
    return (
        ReportFigure(
            folder / "map.png",
            "The field from above: what was processed, at which confidence, and every stop.",
            "Map of processed, uncertain and unprocessed ground",
        ),
        ReportFigure(
            folder / "channels.png",
            "Depth, speed and the position's uncertainty over the recording.",
            "Depth, speed and uncertainty over time",
        ),
    )
