"""One frame, step by step: what section IV of the paper does with it, as a page with two pictures."""

from collections.abc import Sequence
from html import escape
from itertools import islice
from pathlib import Path
from typing import NamedTuple

from midnet_bench.drawing.painter import png_of
from midnet_bench.drawing.stills import Tree, draw_fusion, draw_views, tree_of
from midnet_bench.errors import InputError
from midnet_bench.grid import OccupancyGrid
from midnet_bench.io.files import write_atomically
from midnet_bench.midnet.midnet_settings import MIDNetSettings
from midnet_bench.midnet.pipeline import Explanation, Observation
from midnet_bench.recording.inputs import prepared
from midnet_bench.recording.setup import RecordingSetup
from midnet_bench.workflows.export import trial_of
from midnet_bench.workflows.library import simulate

PAGE, GRIDS, FUSION = "steps.html", "steps-grids.png", "steps-fusion.png"
FRAME_S = 0.2
STYLE = "body{font:16px/1.5 sans-serif;max-width:62em;margin:2em auto;padding:0 1em}img{max-width:100%}"


class ExplainedFrame(NamedTuple):
    """A frame of a trial or a recording with all that the page shows of it."""

    title: str  # of which trial or recording, and when
    prior_map: OccupancyGrid
    observations: Sequence[Observation]  # of each robot, in index order
    explanation: Explanation
    settings: MIDNetSettings
    has_paper_fusion: bool  # whether Algorithms 3 and 4 fused the boxes


def steps_of_trial(
    directory: str | Path, seed: int | None, frame: int, where: Sequence[str], output: Path, guard: int | None
) -> list[Path]:
    """Walk one frame of a trial through section IV, see :func:`write_steps`; the files written.

    The trial runs again up to that frame, so it needs no recording.

    Args:
        directory: of a campaign of guarded arenas.
        seed: of the trial; the campaign's only one unless given.
        frame: counted from 1.
        where: ``FACTOR=VALUE`` of the grid, as many as it takes to name one cell.
        output: a folder.
        guard: whose grids are shown, from 1.

    Raises:
        InputError: several trials match, there is no such frame, or the detector is not the paper's.
    """
    experiment, parameters, seed = trial_of(directory, seed, where)
    parameters = {**parameters, "record": False}
    with simulate(experiment, seed=seed, explain=True, **parameters) as frames:
        shown = next(islice(frames, frame - 1, None), None) if frame > 0 else None
    if shown is None:
        raise InputError(f"--frame {frame}: the trial has fewer frames, counted from 1")
    midnet = getattr(shown, "midnet", shown)
    if midnet.explanation is None:
        raise InputError(f"--steps: detector={parameters['detector']} does not work by the paper's steps")
    trial = frames.trial
    explained = ExplainedFrame(
        f"{experiment}, seed {seed}, frame {frame} ({frame * FRAME_S:.1f} s)",
        *(trial.prior_map, midnet.observations, midnet.explanation, trial.parameters.midnet),
        has_paper_fusion=parameters.get("fusion", "paper") == "paper",
    )
    return write_steps(explained, output, guard)


def steps_of_recording(files: Sequence[Path], setup: RecordingSetup, frame: int, output: Path) -> list[Path]:
    """Walk one frame of a recording through section IV, see :func:`write_steps`; the files written.

    Args:
        files: the recordings.
        setup: as for a replay; the first of its presets is shown.
        frame: counted from 0, as in ``boxes.csv``.
        output: a folder.

    Raises:
        InputError: the recordings or the setup cannot be used, there is no such frame, or the detector is
            not the paper's.
    """
    with prepared(files, setup, lambda line: None) as inputs:
        name, prior_map = inputs.setup.presets[0], inputs.prior_map
        settings = inputs.settings()[name]
        played = inputs.replay({name: settings})
        shown = next((one for one in played.frames() if one.number == frame), None)
        if shown is None:
            raise InputError(f"--steps {frame}: there are frames 0 to {played.tally.frames - 1}")
        seen = shown.outputs[name].observations
        midnet = played.nodes[name].midnet.update(seen, explain=True, allies=shown.fresh_allies)
        if settings.detector != "midnet" or midnet.explanation is None:
            raise InputError(f"--steps: detector={settings.detector} does not work by the paper's steps")
        explained = ExplainedFrame(
            f"{inputs.recorded.names[0]}, preset {name}, frame {frame}",
            *(prior_map, seen, midnet.explanation, settings.midnet),
            has_paper_fusion=settings.fusion == "paper",
        )
        return write_steps(explained, output)


def write_steps(frame: ExplainedFrame, output: Path, guard: int | None = None) -> list[Path]:
    """Write ``steps.html`` and its pictures; their paths.

    Args:
        frame: with at least one robot that has sent a costmap.
        output: a folder, made if it is not there.
        guard: whose grids are shown, from 1; the first with the most boxes unless given.

    Raises:
        InputError: there is no such guard, or the folder cannot be written.
        MidnetBenchError: there is no room.
    """
    views = frame.explanation.views
    counts = [len(view.found) for view in views]
    shown = 1 + counts.index(max(counts)) if guard is None else guard
    if not 1 <= shown <= len(views):
        raise InputError(f"--guard {shown}: this frame has guards 1 to {len(views)}")
    pictures = {GRIDS: draw_views(frame.observations[shown - 1], frame.explanation, shown - 1)}
    tree = None
    if frame.has_paper_fusion and len(views) > 1:
        tree = tree_of(frame.explanation, frame.settings.iou_fuse)
        pictures[FUSION] = draw_fusion(frame.prior_map, tree)
    files = {name: png_of(picture) for name, picture in pictures.items()}
    for name, content in {**files, PAGE: _page(frame, shown, tree).encode()}.items():
        write_atomically(output / name, content)
    return [output / PAGE, *(output / name for name in files)]


def _page(frame: ExplainedFrame, guard: int, tree: Tree | None) -> str:
    """HTML: the steps with this frame's numbers."""
    explanation, settings = frame.explanation, frame.settings
    costmap = frame.observations[guard - 1].costmap
    found = [len(view.found) for view in explanation.views]
    removed, kept = len(explanation.removed), sum(len(view.kept) for view in explanation.views)
    own = [f"guard {one.ally + 1}" for one in explanation.removed if one.detection.robot == guard - 1]
    side_m = costmap.resolution * costmap.width
    one_robot = [
        f"<b>Costmap.</b> Guard {guard}, at the blue cross, sends {costmap.width} x {costmap.height} cells "
        f"of {costmap.resolution:g} m, {side_m:.3g} m wide.",
        f"<b>Grid A (Eq. 1).</b> Cells with a cost of {settings.thresh_local} (<code>thresh_local</code>) or "
        "more are occupied: black.",
        "<b>Grid B (Algorithm 1, Eqs. 2 to 4).</b> The binary prior map, cropped around the guard's pose.",
        "<b>Grids C and D (Eqs. 5 and 6).</b> C is occupied in A and in B: mapped walls. D is occupied in A "
        "alone: intruders and teammates, white.",
        f"<b>Boxes (IV.B.4).</b> Each connected group of cells of D has a box: {found[guard - 1]} here."
        + f" The guards have {', '.join(map(str, found))}, {sum(found)} in all." * (len(found) > 1),
    ]
    team = [
        f"<b>Allies (Algorithm 2).</b> A box that overlaps the square of a teammate's pose, side "
        f"{settings.ally_diameter_m:g} m, with an IoU (Eq. 7) of {settings.iou_ally:g} or more is removed: "
        f"{removed} of the {sum(found)}"
        + (f", of guard {guard} those of {', '.join(own)}" if own else "")
        + f". {kept} are left.",
    ]
    if tree is not None:
        into = {
            guards: ", ".join(f"{tree.names[k]} into {tree.names[j]}" for k, j in node.lost)
            for guards, node in tree.nodes.items()
        }
        fused = "; ".join(f"guards {i + 1} to {k + 1}: {text}" for (i, k), text in into.items() if text)
        team += [
            "<b>The tree (Algorithm 3).</b> The list of guards is halved until each part is one guard. Then "
            "the halves are fused from the bottom up.",
            f"<b>Fusing two lists (Algorithm 4).</b> Two boxes with an IoU of {settings.iou_fuse:g} or more "
            f"are one intruder; the larger one stays. {fused or 'No two are fused here'}. "
            f"{len(tree.root.left)} boxes are left.",
        ]
    picture = f'<img src="{FUSION}" alt="All boxes on the map, and the tree of Algorithm 3">' if tree else ""
    return f"""<!DOCTYPE html>
<html lang="en"><meta charset="utf-8"><meta name="viewport" content="width=device-width">
<title>One frame, step by step</title><style>{STYLE}</style>
<h1>One frame, step by step</h1>
<p>What section IV of the paper does with one frame: {escape(frame.title)}.</p>
<h2>What one robot finds (sections IV.A and IV.B)</h2>
<img src="{GRIDS}" alt="Costmap, grids A to D and boxes of guard {guard}">
<ol>{"".join(f"<li>{text}</li>" for text in one_robot)}</ol>
<h2>What the team keeps (section IV.C)</h2>
{picture}
<ol start="{len(one_robot) + 1}">{"".join(f"<li>{text}</li>" for text in team)}</ol>
</html>
"""
