"""An exploration as pictures: its moments, six of them on a page, and how they are called."""

import numpy as np

from midnet_bench.drawing.canvas import Picture
from midnet_bench.drawing.growth_view import MOMENTS, TILE_PX, MapPainter, growth_page
from midnet_bench.drawing.recording import Moment, Recording
from midnet_bench.drawing.scene import Stage, title_of, view_of
from midnet_bench.experiments.mapping.trial import ExplorationTrial, Snapshot
from midnet_bench.mapping.map_score import reachable_free

MARGIN_M = 0.25


class ExplorationRecording(Recording):
    """An exploration, snapshot by snapshot."""

    def __init__(self, trial: ExplorationTrial) -> None:
        """``trial`` has not begun yet."""
        super().__init__()
        start = trial.layout.robots[0]
        self._within_reach = reachable_free(trial.truth(), (start.x, start.y))

    def take_snapshot(self, snapshot: Snapshot) -> float:
        """The next snapshot; the share of the free cells within reach that is known, 0 to 1."""
        coverage = float(np.mean(snapshot.grid.data[self._within_reach] >= 0))
        self.take(
            Moment(
                snapshot.time_s,
                coverage,
                snapshot.grid,
                snapshot.poses,
                snapshot.believed,
                snapshot.goals,
                ways=[],
            )
        )
        return coverage


def painter_of(trial: Stage, side_px: int) -> MapPainter:
    """Paints an arena's map on a square of pixels."""
    return MapPainter(view_of(trial, MARGIN_M), side_px, side_px)


def exploration_page(trial: ExplorationTrial, recording: Recording) -> Picture:
    """(height, width, 3) six moments from the beginning to the end, evenly spread, in reading order."""
    times_s = np.linspace(recording.clocks[0], recording.clocks[-1], MOMENTS).tolist()
    painter = painter_of(trial, TILE_PX)
    return growth_page(recording, times_s, painter, heading_of(trial), _caption)


def _caption(moment: Moment) -> str:
    return f"{moment.clock:.0f} s: {percent(moment.known)} explored"


def heading_of(trial: ExplorationTrial) -> str:
    """Which exploration it is, in a line."""
    return f"{title_of(trial)}: {team_of(trial)}"


def team_of(trial: ExplorationTrial) -> str:
    """How many robots it was."""
    robots = trial.parameters.robots
    return f"explored by {robots} Burger{'s' if robots > 1 else ''}"


def percent(share: float) -> str:
    """A share with one digit, rounded down: nothing is called done that is not."""
    return f"{np.floor(1000.0 * share) / 10.0:.1f} %"
