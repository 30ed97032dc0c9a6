"""The figure of disturbances: what each does to recall, precision and one-to-one F1, by team size."""

from collections.abc import Mapping, Sequence
from itertools import cycle
from math import ceil
from textwrap import wrap
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from midnet_bench.analysis.frames import Results
from midnet_bench.analysis.statistics import MEAN_METHOD
from midnet_bench.campaign.trial import Scalar
from midnet_bench.drawing.charts import FONT_PT, STYLES, add_estimates, chart, labelled, light_grid
from midnet_bench.drawing.plots import own_style
from midnet_bench.experiments.detection.parameters import DetectionParameters
from midnet_bench.experiments.robustness.parameters import NONE, changes_of
from midnet_bench.experiments.robustness.tables import MEASURES, Scores, score, scores_of

PER_ROW = 6
"""panels side by side"""
DODGE = 0.12
"""between team sizes, in places along x"""
ONE_LINE = 19
"""characters below an axis that need no second line"""
HEADINGS = {
    "lidar_noise": "LiDAR noise",
    "lidar_dropout": "beams without return",
    "lidar_hz": "LiDAR rate (Hz)",
    "start_error_m": "wrong start pose",
    "start_error_deg": "wrong start pose",
    "message_delay_s": "message delay (s)",
    "message_loss": "messages lost",
    "mobile_scale": "intruders' size",
    "stationary_scale": "intruders' size",
    "intruder_speed_mps": "intruders' speed (m/s)",
    "prior_map": "prior map",
    "dying_guards": "a guard dies",
}
"""what a panel is about, by the first option that its disturbances change; else the option's own name"""
WORDS = {
    "lidar_dropout": "{:.0%}",
    "message_loss": "{:.0%}",
    "wheel_slip": "slip {:g} m",
    "start_error_m": "{:g} m",
    "start_error_deg": "{:g}°",
    "mobile_scale": "mobile x {:g}",
    "stationary_scale": "standing x {:g}",
    "dying_guards": "dead: {}",
    "dying_after_s": "after {:g} s",
    "message_timeout_s": "time-out {:g} s",
    "ukf_imu_yaw_variance": "yaw var. {:g}",
}
"""how a value is written below an axis"""
LABELS = {"recall": "recall", "precision": "precision", "f1_one_to_one": "one-to-one F1"}


class Panel(NamedTuple):
    """What stands side by side along one axis."""

    heading: str
    disturbances: Sequence[str]
    """from left to right, ``NONE`` among them"""
    names: Sequence[str]
    """what to write below each"""
    is_scale: bool
    """whether they are values of one number, so that a line between them means something"""


def figures(results: Results) -> dict[str, Figure]:
    """``robustness``: small multiples by disturbance, a line per team size; none without disturbances."""
    scores = results.once(scores_of)
    drawn = panels(list(dict.fromkeys(name for _, name, _ in scores)), results.definition.parameters)
    return {"robustness": figure(scores, drawn)} if drawn else {}


def panels(disturbances: Sequence[str], parameters: Mapping[str, Scalar]) -> list[Panel]:
    """The disturbances by what they change; ``parameters`` are those of undisturbed trials."""
    grouped: dict[str, list[str]] = {}
    for name in disturbances:
        if name != NONE:
            key = next(iter(changes_of(name)))
            grouped.setdefault(HEADINGS.get(key, key), []).append(name)
    undisturbed = {**DetectionParameters.defaults(), **parameters}
    return [_panel(heading, names, undisturbed) for heading, names in grouped.items()]


def _panel(heading: str, disturbances: Sequence[str], undisturbed: Mapping[str, Scalar]) -> Panel:
    changes: dict[str, Mapping[str, Scalar]] = {name: changes_of(name) for name in disturbances}
    keys = {next(iter(change)) for change in changes.values()}
    usual = {key: undisturbed[key] for key in keys} if len(keys) == 1 else {}
    changes = {NONE: usual, **changes}
    values = [next(iter(change.values()), None) for change in changes.values()]
    is_scale = all(len(change) == 1 for change in changes.values()) and all(
        isinstance(value, int | float) and not isinstance(value, bool) for value in values
    )
    names = list(changes)
    if is_scale:
        names = [names[i] for i in np.argsort(np.array(values, dtype=np.float64), kind="stable")]
    return Panel(heading, names, [_words(changes[name]) for name in names], is_scale)


def _words(changes: Mapping[str, Scalar]) -> str:
    """``encoder slip 0.01 m ukf+map``, in two lines at most: more of them would cover their neighbours."""
    words = []
    for key, value in changes.items():
        shown = value.split(":")[0] if isinstance(value, str) else value  # a map's digest is no word
        usual = "{:g}" if isinstance(shown, float) else "{}"
        words.append(WORDS.get(key, usual).format(shown))
    text = " ".join(words) or "default"
    return text if len(text) <= ONE_LINE else "\n".join(wrap(text, len(text) // 2 + 4))


@own_style()
def figure(scores: Scores, drawn: Sequence[Panel]) -> Figure:
    """A column of three axes for each panel, recall, precision and one-to-one F1 below each other."""
    columns = min(PER_ROW, len(drawn))
    blocks = ceil(len(drawn) / columns)
    picture = chart(2.2 * columns + 0.6, 5.2 * blocks + 0.6, w_pad=0.03, h_pad=0.03)
    teams = list(dict.fromkeys(team for team, _, _ in scores))
    limits = {measure: _limits(scores, measure) for measure in MEASURES}
    for place, panel in enumerate(drawn):
        block, column = divmod(place, columns)
        for line, measure in enumerate(MEASURES):
            number = (block * len(MEASURES) + line) * columns + column + 1
            axes = picture.add_subplot(blocks * len(MEASURES), columns, number)
            _draw(axes, scores, panel, teams, measure)
            axes.set_ylim(*limits[measure])
            if column == 0:
                axes.set_ylabel(LABELS[measure], fontsize=FONT_PT)
            else:
                axes.tick_params(labelleft=False)
            if line == 0:
                axes.set_title(panel.heading, fontsize=FONT_PT)
            axes.tick_params(labelbottom=line == len(MEASURES) - 1)
    # a legend shows the lines if there are any
    first = next((place for place, panel in enumerate(drawn) if panel.is_scale and place < columns), 0)
    handles, labels = labelled(picture.axes[len(MEASURES) * first])
    seeds = sorted({len(by_seed) for by_seed in scores.values()})
    counts = "-".join(map(str, dict.fromkeys((seeds[0], seeds[-1]))))
    picture.legend(
        handles,
        labels,
        fontsize=FONT_PT,
        frameon=False,
        loc="outside upper left",
        ncols=len(labels),
        title=f"{counts} seeds per point, {MEAN_METHOD}; grey: undisturbed",
        title_fontsize=FONT_PT - 1,
        alignment="left",
    )
    return picture


def _draw(axes: Axes, scores: Scores, panel: Panel, teams: Sequence[str], measure: str) -> None:
    places = np.arange(len(panel.disturbances))
    for number, (team, style) in enumerate(zip(teams, cycle(STYLES))):
        usual = score(scores, team, NONE, measure)
        axes.axhline(usual.value, color="#999999", linewidth=0.8, linestyle=style.dash, zorder=1)
        shift = DODGE * (number - (len(teams) - 1) / 2)
        estimates = [score(scores, team, name, measure) for name in panel.disturbances]
        style = style if panel.is_scale else style._replace(dash="none")
        add_estimates(axes, (places + shift).tolist(), estimates, style, team)
    light_grid(axes)
    axes.set_xlim(-0.5, len(places) - 0.5)
    axes.set_xticks(places, panel.names, fontsize=FONT_PT - 2)
    axes.tick_params(axis="y", labelsize=FONT_PT - 1)
    if not panel.is_scale:
        axes.tick_params(axis="x", labelrotation=45)
        for label in axes.get_xticklabels():
            label.set(horizontalalignment="right", rotation_mode="anchor")


def _limits(scores: Scores, measure: str) -> tuple[float, float]:
    """From a little below the least mean that is drawn up to 1."""
    keys = {(team, name) for team, name, one in scores if one == measure}
    means = [score(scores, team, name, measure) for team, name in keys]
    least = np.nanmin([min(one.value, one.low) for one in means], initial=1.0)
    return max(0.0, float(least) - 0.03), 1.02
