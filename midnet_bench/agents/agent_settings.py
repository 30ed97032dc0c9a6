"""What can be set of patrol, pursuit and of how a robot keeps at a goal."""

from dataclasses import dataclass

from midnet_bench.plugins import ExtensionPoint
from midnet_bench.settings import Settings, option

PATROLS = ExtensionPoint(
    option="patrol",
    entry_points="midnet_bench.patrols",
    method="next_point",
    own={
        "paper": None,
        "cyclic": "midnet_bench.agents.graph_patrols:CyclicRoute",
        "reactive": "midnet_bench.agents.graph_patrols:ConscientiousReactive",
        "coordinated": "midnet_bench.agents.graph_patrols:CoordinatedIdleness",
    },
)
PURSUITS = ExtensionPoint(
    option="pursuit",
    entry_points="midnet_bench.pursuits",
    method="pursue",
    own={
        "nearest": "midnet_bench.agents.pursuit:Nearest",
        "all": "midnet_bench.agents.pursuit:All",
        "assignment": "midnet_bench.agents.pursuit:Assignment",
        "none": "midnet_bench.agents.pursuit:Nobody",
        "oracle": None,
    },
)
_PURSUIT = {
    "nearest": "the nearest one while the others patrol",
    "all": "every guard after the intruder nearest to it",
    "assignment": "pairs of least total distance",
    "oracle": "nearest, with targets from the referee",
}


@dataclass(frozen=True)
class GoalSettings(Settings):
    """How long a robot keeps at a goal."""

    timeout_s: float = option(
        30.0,
        "A robot that has stayed within half a metre of one place for this long gives its goal up and"
        " gets another.",
        gt=0,
        le=600,
        key="goal_timeout_s",
        source="ours: the paper has no rule for goals that are not reached",
    )


@dataclass(frozen=True)
class PatrolSettings(Settings):
    """The random patrol of section V.B."""

    rule: str = option(
        "paper",
        f"Where guards go that have nothing to do: {PATROLS.choices(paper='random points of section V.B')}.",
        key="patrol",
        source="paper: V.B",
    )
    z_factor: float = option(
        0.5,
        "Least distance between patrol goals, as a share of the arena's diagonal divided by the "
        "number of robots (z = p / 2q in Eq. 12 is 0.5).",
        gt=0,
        le=2,
        source="paper: V.B, Eq. 12",
    )
    clearance_m: float = option(
        0.4,
        "Patrol goals keep this far from any occupied cell (third condition of section V.B).",
        ge=0,
        le=5,
        key="patrol_clearance_m",
        source="paper: V.B, third condition",
    )


@dataclass(frozen=True)
class PursuitSettings(Settings):
    """Which guards go after a detected intruder, and for how long."""

    rule: str = option(
        "nearest",
        f"Which guards go after a detected intruder: {PURSUITS.choices(**_PURSUIT)}. Targets are tracks of "
        "MIDNet's boxes; under oracle the referee names the intruder of each box instead, and tells who is "
        "caught or gone.",
        key="pursuit",
        source="ours: the paper converges to intruders without a rule",
    )
    ignores_allies: bool = option(
        True,
        "No pursuit rule is handed a box that overlaps the square of side ally_diameter_m about any guard, "
        "its finder too, where MIDNet believes that guard to be. Under pursuit: oracle the referee has "
        "named the intruder already, and no box is left out.",
        key="pursuit_ignores_allies",
        source="ours: IV.C.2, what is left 'must be related to the intruders'",
    )
    timeout_s: float = option(
        3.0,
        "A pursuit is given up this long after the last detection of its target.",
        gt=0,
        le=600,
        key="pursuit_timeout_s",
        source="ours: the paper has no rule of pursuit",
    )
    retarget_m: float = option(
        0.25,
        "A pursuer gets a new goal once its target has moved this far; a Burger needs more than a "
        "second for 0.25 m.",
        ge=0,
        le=5,
        key="pursuit_retarget_m",
        source="ours: the paper has no rule of pursuit",
    )
