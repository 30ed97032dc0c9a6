"""Makes the pictures of ``docs/walkthrough.md``: ``python docs/make_walkthrough.py``."""

from pathlib import Path

import midnet_bench as mb
from midnet_bench.drawing.painter import png_of
from midnet_bench.drawing.stills import draw_fusion, draw_views, tree_of
from midnet_bench.experiments.guarded.guarded_arena import ObservedFrame
from midnet_bench.grid import OccupancyGrid

IMAGES = Path(__file__).with_name("images")
SEED, FRAME, GUARD_SHOWN = 1, 226, 3  # the frame has few boxes, and a fusion at each level of the tree


def shown_frame() -> tuple[OccupancyGrid, ObservedFrame]:
    """The prior map, and the frame that the page shows."""
    with mb.simulate(seed=SEED, robots=5, frames=FRAME, engine="fast", explain=True) as frames:
        *_, frame = frames
    return frames.trial.prior_map, frame


def main() -> None:
    """Write both pictures."""
    prior, frame = shown_frame()
    found = frame.midnet.explanation
    assert found is not None
    guard = GUARD_SHOWN - 1
    pictures = {
        "walk-grids.png": draw_views(frame.observations[guard], found, guard),
        "walk-fusion.png": draw_fusion(prior, tree_of(found, mb.MIDNetSettings().iou_fuse)),
    }
    for name, picture in pictures.items():
        (IMAGES / name).write_bytes(png_of(picture))
        print(IMAGES / name)


if __name__ == "__main__":
    main()
