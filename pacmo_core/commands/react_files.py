"""Files of reactions: Parquet, or a BVH file a person and sample."""

from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pacmo_core.commands.bvh_fidelity import Fidelity, planted_weights
from pacmo_core.commands.captures import OutputSpace, bvh_text, is_parquet, read_file
from pacmo_core.commands.reading import check_axis, check_unit
from pacmo_core.commands.rig import TargetRig
from pacmo_core.data.interaction import Interaction, Motion
from pacmo_core.data.names import file_stem
from pacmo_core.data.skeleton import Skeleton
from pacmo_core.formats.inverse_kinematics import contact_targets, proximity_weights
from pacmo_core.formats.registry import PersonMotion
from pacmo_core.project.workspace import CommandError
from pacmo_core.store.files import write_text
from pacmo_core.store.motions import write_motions


@dataclass(frozen=True)
class Reactions:
    """Reactions to one partner.

    Parameters
    ----------
    name : of the partner's capture
    skeleton : of both
    times : (T,) float64, seconds
    partner : (T, J, 3) float32, metres
    samples : (S, T, J, 3) float32, metres
    rig : on which BVH files of the reaction are; None for the joints of the model
    partner_rig : of whom a copy is the partner's BVH file; None for the joints of the model
    body : whose bone lengths the reactions have, in words
    """

    name: str
    skeleton: Skeleton
    times: NDArray[np.float64]
    partner: Motion
    samples: Motion
    rig: TargetRig | None = None
    partner_rig: TargetRig | None = None
    body: str = "a body of the model's choosing (--body, --rig)"

    @property
    def sole(self) -> float:
        """Metres by which the soles of the rig are lower, under its joints, than the partner's."""
        own, other = (rig.sole if rig else 0.0 for rig in (self.rig, self.partner_rig))
        return max(0.0, own - other)


def check_reactions_output(out: Path, space: OutputSpace) -> None:
    """Reject an output without a known suffix, or one that has another unit or axis."""
    if out.suffix.lower() not in (".parquet", ".bvh", "") and not out.is_dir():
        # Its plots take half a second to import.
        from pacmo_core.commands.export import WRITERS as EXPORTED  # noqa: PLC0415

        wanted = f"{out}: wanted a .parquet or .bvh file, or a folder for BVH files"
        if out.suffix.lower() not in EXPORTED:
            others = ", ".join(suffix for suffix in EXPORTED if suffix not in (".parquet", ".bvh"))
            raise CommandError(f"{wanted}; pacmo export makes {others} of these")
        stored, bvh = (out.with_suffix(suffix).name for suffix in (".parquet", ".bvh"))
        raise CommandError(
            f"{wanted}; for others: "
            f"react ... --out {stored}, then pacmo export {stored}:NAME#0000 --out {out.name}, "
            "with NAME the partner's file without its suffix, or the clip; with --rig: react ... "
            f"--out {bvh}, then pacmo view {out.stem}_0_A.bvh+{out.stem}_0_B.bvh"
        )
    check_axis(space.up, "--to-up")
    check_unit(space.unit, "--to-unit")
    if is_parquet(out) and space != OutputSpace():
        raise CommandError(f"{out}: Parquet is always metres, y up; leave out --to-unit, --to-up")


@dataclass(frozen=True)
class Written:
    """Files of reactions.

    Parameters
    ----------
    files : in the order of the samples, the partner's before the reaction's
    samples : (S, T, J, 3) float32, metres, as they are in the files
    fidelity : how well the files hold the motions
    in_files : the partner, and the reaction of each sample, with all joints and End Sites of
        their files
    """

    files: list[Path]
    samples: Motion
    fidelity: Fidelity
    in_files: list[PersonMotion]


def write_reactions(reactions: Reactions, out: Path, space: OutputSpace) -> Written:
    """Write the files, each atomically."""
    if is_parquet(out):
        with write_motions(out, reactions.skeleton) as writer:
            for number, reaction in enumerate(reactions.samples):
                pair = Interaction(reactions.skeleton, reactions.times, reactions.partner, reaction)
                writer.add(f"{reactions.name}#{number:04d}", pair)
        people = [
            PersonMotion(reactions.skeleton, reactions.times, motion)
            for motion in (reactions.partner, *reactions.samples)
        ]
        return Written([out], reactions.samples, Fidelity(), people)
    return _write_bvh(reactions, out, space)


def output_files(out: Path, name: str, n_samples: int) -> list[Path]:
    """Return the files of reactions to a partner of this name: of each sample the partner's first.

    BVH files are in a folder under the partner's name, or beside ``out`` under its own.
    """
    if is_parquet(out):
        return [out]
    is_folder = not out.suffix or out.is_dir()
    folder, stem = (out, file_stem(name)) if is_folder else (out.parent, out.stem)
    return [folder / f"{stem}_{number}_{p}.bvh" for number in range(n_samples) for p in "AB"]


def _write_bvh(reactions: Reactions, out: Path, space: OutputSpace) -> Written:
    """Name files so that the preset ``pair`` finds the two people of each sample.

    The partner is the same in all samples: its joints are weighted by the nearest of them.
    """
    partner = PersonMotion(reactions.skeleton, reactions.times, reactions.partner)
    people = [replace(partner, motion=sample) for sample in reactions.samples]
    near = [proximity_weights(partner.motion, person.motion) for person in people]
    weights = np.max([of_partner for of_partner, _ in near], axis=0) + planted_weights(partner)
    rig, of_partner = reactions.rig, reactions.partner_rig
    text_of = rig.text if rig else bvh_text
    partner_text = (
        of_partner.copied(partner, space)
        if of_partner
        else bvh_text(partner, partner.motion, weights, space)
    )
    rigs = of_partner, rig
    files = output_files(out, reactions.name, len(people))
    samples: list[Motion] = []
    in_files: list[PersonMotion] = []
    fidelity = Fidelity()
    for number, (person, (_, weights)) in enumerate(zip(people, near, strict=True)):
        _, aims = contact_targets(partner.motion, person.motion)
        weights = weights + planted_weights(person)
        pair = files[2 * number : 2 * number + 2]
        texts = (partner_text, text_of(person, aims, weights, space))
        for file, of_file in zip(pair, texts, strict=True):
            write_text(file, of_file)
        # Where the reaction is on no rig, its feet end in joints, and so do the partner's.
        has_ends = (None not in rigs, rig is not None)
        read = [
            read_file(file, asdict(space), has_ends=ends)
            for file, ends in zip(pair, has_ends, strict=True)
        ]
        found = [
            replace(wanted, motion=_on_model(one, own).select_joints(wanted.skeleton).motion)
            for one, own, wanted in zip(read, rigs, (partner, person), strict=True)
        ]
        label = f"sample {number}" if len(people) > 1 else ""
        fidelity += Fidelity.of((partner, person), found, pair, label)
        samples.append(found[1].motion)
        in_files += read if not in_files else read[1:]
    return Written(files, np.stack(samples), fidelity, in_files)


def _on_model(person: PersonMotion, rig: TargetRig | None) -> PersonMotion:
    return rig.on_model(person) if rig else person


def files_line(reactions: Reactions, files: list[Path], space: OutputSpace) -> str:
    """Say which files are of the partner and which are the reactions, and on whose body."""
    samples, rig = len(reactions.samples), reactions.rig
    text = f"{samples} x {len(reactions.times)} frames"
    body = f"bone lengths of {rig.file}" if rig else reactions.body
    if len(files) == 1:
        name = reactions.name
        last = f" ... {name}#{samples - 1:04d}" if samples > 1 else ""
        return (
            f"{text} in {files[0]} as {name}#0000{last}: person_a is the partner, "
            f"person_b the reaction, with {body}"
        )
    made = f"{files[1]}{f' ... {files[-1]}' if samples > 1 else ''}"
    if rig is None:
        return (
            f"{text}: the partner in {files[0]}, the reaction in {made}, with {body}; both in "
            f"{space}"
        )
    partner = "as captured" if reactions.partner_rig else "on the joints of the model"
    return (
        f"{text}: the partner in {files[0]}, {partner}; the reaction in {made}, on the rig of "
        f"{rig.file}; both in {space}"
    )
