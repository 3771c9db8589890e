"""Write NTU RGB+D ``.skeleton`` text, as Microsoft's Kinect v2 recorder of that dataset does.

Positions are in the camera's frame: metres, y up, x towards the left of someone who looks out of
the camera, z away from it; this is right-handed. Depth and colour pixels follow from a pinhole
fitted to published files (to 0.1 and 2 pixels). Orientations are written as zeros, as
Kinect does for joints without one; hands are of unknown state and the body does not lean.
"""

from collections.abc import Iterable, Mapping

import numpy as np
from numpy.typing import NDArray

from pacmo_core.data.interaction import Interaction, Motion
from pacmo_core.data.skeleton import NTU25

# Rows: depth camera, colour camera; columns: focal length, centre x, centre y; pixels.
_CAMERAS = ((367.0, 256.3, 208.5), (1057.0, 978.0, 567.0))
_N_JOINTS = len(NTU25.joints)
# Seven digits and a capital E, as in the published files.
_JOINT = " ".join(["%.7G"] * 7) + " 0 0 0 0 2\n"
_BODY = f"%d 0 0 0 0 0 0 0 0 2\n{_N_JOINTS}\n" + _JOINT * _N_JOINTS


def format_ntu(interaction: Interaction, body_ids: tuple[int, int]) -> bytes:
    """Format an interaction as one ``.skeleton`` file; the format has no frame rate.

    Parameters
    ----------
    interaction : on the ``NTU25`` skeleton, in the camera's frame (every z > 0)
    body_ids : IDs of person a and person b; the published ones have 17 digits

    Raises
    ------
    ValueError
        If the skeleton is another, a joint is not before the camera, or the two IDs are one.
    """
    if interaction.skeleton != NTU25 or body_ids[0] == body_ids[1]:
        raise ValueError(
            f"wanted skeleton {NTU25.name} and two body IDs; "
            f"got {interaction.skeleton.name} and {body_ids}"
        )
    a, b = body_ids
    pairs = zip(interaction.person_a, interaction.person_b, strict=True)
    return format_frames({a: pose_a, b: pose_b} for pose_a, pose_b in pairs)


def format_frames(frames: Iterable[Mapping[int, Motion]]) -> bytes:
    """Format frames of any number of bodies as one ``.skeleton`` file.

    Parameters
    ----------
    frames : for each frame, the ``(25, 3)`` pose in metres of each body by its ID

    Raises
    ------
    ValueError
        If a pose is not ``(25, 3)`` or not before the camera.
    """
    texts = [f"{len(bodies)}\n" + "".join(map(_body, bodies, bodies.values())) for bodies in frames]
    return f"{len(texts)}\n{''.join(texts)}".encode("ascii")


def _body(body_id: int, pose: Motion) -> str:
    if pose.shape != (_N_JOINTS, 3) or not (pose[:, 2] > 0).all():
        raise ValueError(
            f"pose must be ({_N_JOINTS}, 3) with every z > 0, before the camera; "
            f"got {pose.shape}, least z {pose[..., -1].min()}"
        )
    return _BODY % (body_id, *np.hstack([pose, _pixels(pose)]).ravel().tolist())


def _pixels(pose: Motion) -> NDArray[np.float32]:
    """``(25, 4)``: depth x, depth y, colour x, colour y; y grows downwards."""
    x, y = pose[:, 0] / pose[:, 2], pose[:, 1] / pose[:, 2]
    columns = [[f * x + centre_x, centre_y - f * y] for f, centre_x, centre_y in _CAMERAS]
    return np.vstack([*columns[0], *columns[1]]).T
