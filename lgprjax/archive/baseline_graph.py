"""A map's baselines and the matches between them as a pose graph, and what its solution says of each baseline."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from lgprjax.archive.baseline_matches import PassMatches, label_sigmas, supported
from lgprjax.formats import MapFile
from lgprjax.navigation.label_process import LabelChain, LabelModel
from lgprjax.navigation.pose_graph import FixEdges, GraphSolution, misfit, solve_graph

_BREAK_M = 1.0
"""Neighbouring stations farther apart are a gap or a jump of the labels: nothing ties what lies to both sides."""

_MATCH_SIGMA_M = 0.01
"""Of a match, beside its own covariance: what gridding and the shape of the labels within a tile leave."""
_MATCH_SIGMA_RAD = np.radians(0.1)

_SIGMA_PLACES = 20  # of a baseline, at which its sigmas are asked for


class StationChains(NamedTuple):
    """A map's stations along chains of labels that hang together.

    Attributes:
        chains: stretches of baselines without a break.
        chain, at_m: chain of each station, and its place along the baseline's path.
    """

    chains: tuple[LabelChain, ...]
    chain: Int[np.ndarray, " scan"]
    at_m: Float[np.ndarray, " scan"]


class BaselineChange(NamedTuple):
    """What making labels agree did to one baseline.

    Attributes:
        drive: number of the baseline.
        matches, kept: of its places and on its ground, and those of them that took part; without any it stays as it is.
        moved_rms_m, moved_max_m: of its labels.
        sigma_before_m, sigma_after_m: of its labels' east and north, root mean square; NaN after, where it is tied to
            nothing.
    """

    drive: int
    matches: int
    kept: int
    moved_rms_m: float
    moved_max_m: float
    sigma_before_m: float
    sigma_after_m: float


class Consistency(NamedTuple):
    """Distance of each match from where labels put it, over the matches that are ok and not alone.

    Attributes:
        rms_m: root mean square over those that took part.
        median_m: over all of them.
    """

    rms_m: float
    median_m: float


class AgreedBaselines(NamedTuple):
    """A map's stations where its baselines agree.

    Attributes:
        pose: of all stations.
        tried, matched, used, kept: places of passes tried on earlier passes; matches with code ok; those not alone;
            those that the graph believed.
        noise_scale: see ``GraphSolution``.
        before, after: distance of the matches from the labels.
        baselines: one each.
        solution: of the graph; ``stations`` are its chains.
    """

    pose: Float[np.ndarray, "scan 5"]
    tried: int
    matched: int
    used: int
    kept: int
    noise_scale: float
    before: Consistency
    after: Consistency
    baselines: tuple[BaselineChange, ...]
    solution: GraphSolution
    stations: StationChains


def chains_of(source: MapFile) -> StationChains:
    """Chains of a map's baselines: cut where a baseline ends and where neighbouring stations lie far apart."""
    pose, drive = source.pose, source.drive
    sigma_m = label_sigmas(source)
    step_m = np.hypot(*np.diff(pose[:, :2], axis=0).T)
    path_m = np.concatenate([[0.0], np.cumsum(step_m)])
    break_m = max(_BREAK_M, 5.0 * source.description.settings.step_m)
    cut = np.flatnonzero((step_m > break_m) | (np.diff(drive) != 0)) + 1
    starts, stops = np.concatenate([[0], cut]), np.concatenate([cut, [len(pose)]]) - 1
    chains = tuple(
        LabelChain(float(path_m[a]), float(path_m[b]), float(sigma_m[drive[a]]))
        for a, b in zip(starts, stops, strict=True)
    )
    return StationChains(chains, np.repeat(np.arange(len(chains)), stops - starts + 1), path_m)


def edges_of(
    source: MapFile, stations: StationChains, matches: PassMatches, used: Bool[np.ndarray, " row"]
) -> FixEdges:
    """The used matches as edges between chains."""
    ends = np.stack([matches.station[used], matches.ground[used]], axis=1)
    own = np.diag([_MATCH_SIGMA_M**2, _MATCH_SIGMA_M**2, _MATCH_SIGMA_RAD**2])
    return FixEdges(
        chain=stations.chain[ends],
        at_m=stations.at_m[ends],
        label=source.pose[ends][..., [0, 1, 3]],
        found=matches.found[used],
        covariance=matches.covariance[used] + own,
    )


def agree_baselines(source: MapFile, matches: PassMatches, model: LabelModel | None = None) -> AgreedBaselines:
    """Correct a map's labels so that its baselines agree with each other.

    Args:
        source: the map.
        matches: of its passes with each other.
        model: of the labels' errors.
    """
    model, used = model or LabelModel(), supported(matches)
    stations = chains_of(source)
    edges = edges_of(source, stations, matches, used)
    solution = solve_graph(stations.chains, edges, model)
    correction = solution.correction(stations.chain, stations.at_m)
    pose = source.pose.copy()
    pose[:, [0, 1, 3]] += correction
    drives = source.drive[np.stack([matches.station[used], matches.ground[used]], axis=1)]
    return AgreedBaselines(
        pose=pose,
        tried=len(matches.code),
        matched=int(np.sum(matches.code == 0)),
        used=len(edges.found),
        kept=int(solution.kept.sum()),
        noise_scale=solution.noise_scale,
        before=_consistency(edges, np.zeros((2, len(edges.found), 3)), solution.kept),
        after=_consistency(edges, _corrections(edges, solution), solution.kept),
        baselines=tuple(
            _change(source, stations, drives, solution, correction, drive)
            for drive in range(1 + int(source.drive.max()))
        ),
        solution=solution,
        stations=stations,
    )


def _corrections(edges: FixEdges, solution: GraphSolution) -> Float[np.ndarray, "2 edge 3"]:
    return np.stack([solution.correction(edges.chain[:, end], edges.at_m[:, end]) for end in (0, 1)])


def _consistency(
    edges: FixEdges, correction: Float[np.ndarray, "2 edge 3"], kept: Bool[np.ndarray, " edge"]
) -> Consistency:
    """Distances between places and where their fixes put them, both by corrected labels."""
    if not kept.any():
        return Consistency(float("nan"), float("nan"))
    apart = np.hypot(*misfit(edges, *correction)[:, :2].T)
    return Consistency(float(np.sqrt(np.mean(apart[kept] ** 2))), float(np.median(apart)))


def _change(
    source: MapFile,
    stations: StationChains,
    drives: Int[np.ndarray, "edge 2"],
    solution: GraphSolution,
    correction: Float[np.ndarray, "scan 3"],
    drive: int,
) -> BaselineChange:
    own = np.flatnonzero(source.drive == drive)
    mine = np.any(drives == drive, axis=1)
    kept = int(np.sum(mine & solution.kept))
    moved_m = np.hypot(correction[own, 0], correction[own, 1])
    after_m = float("nan")
    if kept:
        asked = own[np.linspace(0, len(own) - 1, _SIGMA_PLACES).astype(int)]
        variance = np.diagonal(solution.covariance(stations.chain[asked], stations.at_m[asked])).reshape(-1, 3)
        after_m = float(np.sqrt(np.mean(variance[:, :2])))
    return BaselineChange(
        drive=drive,
        matches=int(mine.sum()),
        kept=kept,
        moved_rms_m=float(np.sqrt(np.mean(moved_m**2))) if len(own) else 0.0,
        moved_max_m=float(moved_m.max(initial=0.0)),
        sigma_before_m=float(label_sigmas(source)[drive]),
        sigma_after_m=after_m,
    )
