"""Picks of the scene and of gprMax side by side: judged together, printed together."""

from typing import NamedTuple

from validation.full_wave.echoes import RADAR, Pick

HALF_SAMPLE_NS = RADAR.sample_step_ns / 2
# Aside of the antenna, up to where a ray alone must do; beyond, the exact field is later by more (plane_waves.py).
NEAR_M = 0.25


class Row(NamedTuple):
    """One echo in both."""

    label: str
    scene: Pick
    fdtd: Pick

    @property
    def late_ns(self) -> float:
        """How much later the scene's echo is."""
        return self.scene.time_ns - self.fdtd.time_ns


def show(title: str, rows: list[Row]) -> None:
    """Prints the table (pytest -s)."""
    print(f"\n{title}\n{'echo':34}  gprMax ns   scene ns  difference ns  samples  polarity gprMax scene")
    for row in rows:
        late = row.late_ns
        print(
            f"{row.label:34}{row.fdtd.time_ns:11.3f}{row.scene.time_ns:11.3f}{late:+15.3f}"
            f"{late / RADAR.sample_step_ns:+9.2f}{'+' if row.fdtd.value > 0 else '-':>13}"
            f"{'+' if row.scene.value > 0 else '-':>8}"
        )


def judge(rows: list[Row]) -> None:
    """Every echo within half a sample, every polarity the same."""
    late = [f"{row.label}: {row.late_ns:+.3f} ns" for row in rows if abs(row.late_ns) > HALF_SAMPLE_NS]
    assert not late, f"farther apart than half a sample, {HALF_SAMPLE_NS} ns: {late}"
    turned = [row.label for row in rows if row.scene.value * row.fdtd.value <= 0]
    assert not turned, f"polarity differs: {turned}"
