"""Kicks, pushes and punches that land, with a tenth of a second to spare.

Usage: python -m benchmarks.blows [ROW ...] [--json]

In the project after a run: of the test clips of the three acts, the captured frames in which the
two are within 10 cm, and the share of them that the reactions of each row of ``data/reactions/1``
meet: within 15 cm at most 0.1 s before or after. ``ROW_frames`` counts them, over all samples.
"""

from pathlib import Path

from benchmarks._figures import arguments, show
from pacmo_core.data.interaction import Interaction, min_point_distance
from pacmo_core.metrics.contact import nearest_in_time
from pacmo_core.store.motions import stream_motions
from stages.common.files import MOTIONS

CLIPS, REACTIONS = Path("data/clips"), Path("data/reactions/1")
ACTS = ("A050", "A051", "A052")  # NTU's numbers of punch, kick and push, with which names end
CONTACT, MET = 0.1, 0.15  # metres


def main() -> None:
    """Measure and print."""
    parser = arguments(__doc__ or "")
    parser.add_argument("rows", nargs="*", metavar="ROW")
    options = parser.parse_args()
    captured = {name: clip for name, clip in stream_motions(CLIPS / MOTIONS) if name.endswith(ACTS)}
    figures: dict[str, float] = {}
    for row in options.rows or sorted(folder.name for folder in REACTIONS.iterdir()):
        n_met = n_frames = 0
        for file in sorted((REACTIONS / row).glob(f"*/{MOTIONS}")):
            for name, reaction in stream_motions(file):
                if clip := captured.get(name.partition("#")[0]):
                    met, frames = blows(clip, reaction)
                    n_met, n_frames = n_met + met, n_frames + frames
        if not n_frames:
            raise SystemExit(f"{REACTIONS / row}: no reaction to a clip of {', '.join(ACTS)}")
        figures |= {row: n_met / n_frames, f"{row}_frames": n_frames}
    show(figures, as_json=options.json)


def blows(captured: Interaction, reaction: Interaction) -> tuple[int, int]:
    """Count the captured frames of contact that a reaction meets, and all of them."""
    touching = min_point_distance(captured.person_a, captured.person_b) <= CONTACT
    distances = min_point_distance(reaction.person_a, reaction.person_b)
    near = nearest_in_time(distances, reaction.times - reaction.times[0])
    return int((near[touching] <= MET).sum()), int(touching.sum())


if __name__ == "__main__":
    main()
