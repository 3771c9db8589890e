"""Who reacts and to whom: the partner's capture, and the rig or the body of the other person."""

from dataclasses import dataclass, replace
from enum import StrEnum
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pacmo_core.commands.captures import (
    OutputSpace,
    names_clips,
    read_clip,
    some_clips,
)
from pacmo_core.commands.react_files import Reactions
from pacmo_core.commands.reading import (
    PEOPLE,
    ReadOptions,
    ReadPerson,
    Source,
    read_people,
    say_names,
    to_model_joints,
)
from pacmo_core.commands.rig import TargetRig, read_rig, rig_of
from pacmo_core.data.skeleton import OBJECT, Skeleton
from pacmo_core.finish.body import TargetBody, body_of
from pacmo_core.formats.registry import (
    ONE_PERSON_FORMATS,
    PersonMotion,
    holds_one_person,
    select_person,
)
from pacmo_core.project.workspace import CommandError


class BodyOf(StrEnum):
    """Whose bone lengths a reaction gets."""

    partner = "partner"
    captured = "captured"


@dataclass(frozen=True)
class ReactingPeople:
    """The partner, and who reacts.

    Parameters
    ----------
    partner : on the joints of the model
    rig : of the person who reacts; None to leave the body to the model
    partner_rig : the partner's, if that is a BVH file and the other's is known
    measured : whose bone lengths the reaction gets, on the joints of the model; None for the rig's,
        or those of the model's choosing
    body_text : whose these are, in words
    """

    partner: PersonMotion
    rig: TargetRig | None = None
    partner_rig: TargetRig | None = None
    measured: PersonMotion | None = None
    body_text: str = Reactions.body

    @property
    def body(self) -> TargetBody | None:
        """The body of the person who reacts, if it is known."""
        if self.measured:
            return body_of(self.measured.motion, self.measured.skeleton)
        return self.rig.body if self.rig else None

    @property
    def space(self) -> OutputSpace:
        """The unit and axis of BVH files, unless others are stated."""
        return self.rig.space if self.rig else OutputSpace()

    def copied_partner(self, at: NDArray[np.float64], space: OutputSpace) -> TargetRig | None:
        """Return the partner's rig if a file at these times can hold the capture itself."""
        own = self.partner_rig
        times = self.partner.times
        # The frame rate of a BVH file is rounded to six digits: --to-fps 30 is its own.
        has_same_times = len(at) == len(times) and np.allclose(at, times, rtol=1e-4, atol=1e-6)
        return own if own and has_same_times and own.space.up == space.up else None


def read_reacting_people(
    source: Source,
    rig: Path | None,
    skeleton: Skeleton,
    options: ReadOptions,
    clip: str,
    body: BodyOf | None,
) -> ReactingPeople:
    """Read the partner, and the rig or the body of the other, each with its own options."""
    if rig and body:
        raise CommandError(f"--rig {rig} and --body {body}: wanted one of them")
    options = replace(options, with_object=OBJECT in skeleton.joints)
    of_partner = options.of_person(source.label) if rig else options
    _check_person(source, of_partner, clip, rig)
    read = _capture(source, of_partner, clip)
    if rig is None:
        (partner,) = to_model_joints([read.motion], skeleton, [source], options)
        if body is None:
            return ReactingPeople(partner)
        measured, whose = partner, "partner"
        if body == BodyOf.captured:
            measured, whose = _other_person(source, skeleton, options, clip), "captured person"
        return ReactingPeople(
            partner, measured=measured, body_text=f"the bone lengths of the {whose}"
        )
    is_bvh = not names_clips(source.file, clip) and of_partner.format_of(source.file) == "bvh"
    own = _partner_rig(source, read, skeleton, options) if is_bvh else None
    if own is None:
        (partner,) = to_model_joints([read.motion], skeleton, [source], options)
        of_rig = _read_rig(rig, source, skeleton, options)
        say_names([(rig, of_rig.named)])
        return ReactingPeople(partner, of_rig)
    of_rig = _read_rig(rig, source, skeleton, options)
    say_names([(source.file, own.named), (rig, of_rig.named)])
    return ReactingPeople(own.motion, of_rig, own)


def _other_person(
    source: Source, skeleton: Skeleton, options: ReadOptions, clip: str
) -> PersonMotion:
    """Read the other person of a capture of two, on the joints of the model."""
    if not source.person:
        raise CommandError(
            f"{source.file}: --body captured wants a capture of two people, of whom --person names "
            "the partner"
        )
    label = PEOPLE[source.person == PEOPLE[0]]
    other = Source(source.file, label, label)
    (person,) = to_model_joints([_capture(other, options, clip).motion], skeleton, [other], options)
    return person


def _read_rig(file: Path, partner: Source, skeleton: Skeleton, options: ReadOptions) -> TargetRig:
    """Read the rig; where it cannot be read by words that are for both people, say so."""
    label = PEOPLE[partner.label == PEOPLE[0]]
    try:
        return read_rig(Source(file, label, None), skeleton, options.of_person(label))
    except CommandError as fault:
        both = options.for_both()
        if not both:
            if "--joints" not in str(fault):
                raise
            raise CommandError(f"{fault}; words of the rig begin with {label}=") from fault
        option, word = both[0]
        raise CommandError(
            f"{fault}; {', '.join(' '.join(one) for one in both)}: for partner and rig alike; "
            f"{option} {partner.label}={word} is for the partner alone"
        ) from fault


def _partner_rig(
    source: Source, read: ReadPerson, skeleton: Skeleton, options: ReadOptions
) -> TargetRig | None:
    """Return the partner's rig; None if joints must be estimated: then it is not copied."""
    try:
        return rig_of(source, read, skeleton, options)
    except CommandError:
        return None


def _check_person(source: Source, options: ReadOptions, clip: str, rig: Path | None) -> None:
    """Refuse to select one of two people in a file of one; with a rig they name its role."""
    if source.person not in (None, *PEOPLE):
        raise CommandError(f"--person: wanted a or b; got {source.person}")
    if not source.person or rig or names_clips(source.file, clip):
        return
    form = options.format_of(source.file)
    if form in ONE_PERSON_FORMATS or holds_one_person(
        source.file, form, options.settings(form, source.label)
    ):
        raise CommandError(f"{source.file} holds one person: leave out --person {source.person}")


def _capture(source: Source, options: ReadOptions, clip: str) -> ReadPerson:
    if names_clips(source.file, clip):
        if not clip:
            raise CommandError(
                f"{source.file}: name the clip with --clip: {some_clips(source.file)}"
            )
        if options.describes_files:
            raise CommandError(f"{source.file}: clips of a store take no option of other formats")
        clip_of_store = read_clip(source.file, clip)
        return ReadPerson(select_person(clip_of_store, source.person, clip), {})
    (person,) = read_people([source], options.of_captures([source.file]), clip)
    return person
