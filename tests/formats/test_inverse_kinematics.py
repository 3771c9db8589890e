"""Truth: poses that stiff joints can take, made by turning them; and SciPy's own least squares."""

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from pacmo_core.formats.inverse_kinematics import (
    PointTargets,
    aim_bones,
    contact_targets,
    forward_kinematics,
    inverse_kinematics,
    proximity_weights,
    reach_points,
    steady_rotations,
)

# A root with a fork, an arm of three, a leg of two.
PARENTS = (-1, 0, 1, 2, 0, 4, 1)
COUNT = len(PARENTS)


def pose(seed: int, n_frames: int = 4) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Draw root, bones and local rotations, these within half a radian of none."""
    random = np.random.default_rng(seed)
    root = random.normal(size=(n_frames, 3))
    moved = np.repeat(random.normal(size=(1, COUNT, 3)), n_frames, axis=0)
    turns = Rotation.from_rotvec(random.uniform(-0.3, 0.3, (n_frames * COUNT, 3))).as_matrix()
    return root, moved, turns.reshape(n_frames, COUNT, 3, 3)


def equal(wanted: dict[int, np.ndarray]) -> np.ndarray:
    """Weigh all targets alike."""
    return np.ones((len(wanted[0]), len(wanted)))


def test_a_pose_that_can_be_taken_is_taken() -> None:
    root, moved, local = pose(0)
    places, _ = forward_kinematics(PARENTS, root, moved, local)
    wanted = {joint: places[:, joint] for joint in range(COUNT)}
    straight = np.broadcast_to(np.eye(3), local.shape)
    found_root, found = inverse_kinematics(
        PARENTS, wanted, equal(wanted), moved, aim_bones(PARENTS, wanted, moved, straight)
    )
    reached, _ = forward_kinematics(PARENTS, found_root, moved, found)
    np.testing.assert_allclose(reached, places, atol=1e-5)


def test_a_pose_that_is_there_is_left_with_its_twists() -> None:
    root, moved, local = pose(1)
    places, _ = forward_kinematics(PARENTS, root, moved, local)
    wanted = {joint: places[:, joint] for joint in range(COUNT)}
    found_root, found = inverse_kinematics(
        PARENTS, wanted, equal(wanted), moved, aim_bones(PARENTS, wanted, moved, local)
    )
    np.testing.assert_allclose(found, local, atol=1e-9)
    np.testing.assert_allclose(found_root, root, atol=1e-9)


def test_what_cannot_be_met_is_missed_by_the_least_squares() -> None:
    root, moved, local = pose(2, n_frames=1)
    places, _ = forward_kinematics(PARENTS, root, moved, local)
    random = np.random.default_rng(3)
    places = places + 0.1 * random.normal(size=places.shape)
    wanted = {joint: places[:, joint] for joint in range(COUNT)}
    guess = aim_bones(PARENTS, wanted, moved, local)
    ours = (
        forward_kinematics(
            PARENTS,
            *_posed(inverse_kinematics(PARENTS, wanted, equal(wanted), moved, guess), moved),
        )[0]
        - places
    )

    def missed(x: np.ndarray) -> np.ndarray:
        turns = Rotation.from_rotvec(x[3:].reshape(-1, 3)).as_matrix()[None]
        return (forward_kinematics(PARENTS, x[None, :3], moved, turns)[0] - places).reshape(-1)

    start = np.concatenate([root[0], Rotation.from_matrix(local[0]).as_rotvec().reshape(-1)])
    best = least_squares(missed, start)
    assert np.square(ours).sum() <= 2 * best.cost * 1.01
    first = forward_kinematics(PARENTS, *_posed(guess, moved))[0] - places
    assert np.square(ours).sum() < 0.9 * np.square(first).sum()


def _posed(found: tuple[np.ndarray, np.ndarray], moved: np.ndarray) -> tuple[np.ndarray, ...]:
    return found[0], moved, found[1]


def test_joints_without_a_place_keep_their_turns() -> None:
    root, moved, local = pose(4)
    places, _ = forward_kinematics(PARENTS, root, moved, local)
    wanted = {joint: places[:, joint] for joint in (0, 1, 4)}
    _, found = inverse_kinematics(
        PARENTS, wanted, equal(wanted), moved, aim_bones(PARENTS, wanted, moved, local)
    )
    np.testing.assert_allclose(found[:, [2, 3, 5, 6]], local[:, [2, 3, 5, 6]], atol=1e-9)


def test_a_target_of_larger_weight_is_missed_by_less() -> None:
    root, moved, local = pose(5)
    places, _ = forward_kinematics(PARENTS, root, moved, local)
    random = np.random.default_rng(6)
    wanted = {j: places[:, j] + 0.1 * random.normal(size=3) for j in range(COUNT)}
    guess = aim_bones(PARENTS, wanted, moved, local)
    missed = []
    for weight in (1.0, 20.0):
        weights = equal(wanted)
        weights[:, 3] = weight
        found = inverse_kinematics(PARENTS, wanted, weights, moved, guess)
        reached, _ = forward_kinematics(PARENTS, *_posed(found, moved))
        missed.append(np.linalg.norm(reached[:, 3] - wanted[3], axis=-1).mean())
    assert missed[1] < 0.5 * missed[0]


def test_joints_near_the_partner_or_the_ground_have_larger_weights() -> None:
    a = np.zeros((2, 3, 3), np.float32)
    a[:, :, 1] = [0.0, 0.8, 1.6]
    b = a + np.float32([3, 0, 0])
    b[:, 1] = a[:, 1] + np.float32([0.05, 0, 0])
    weights, _ = proximity_weights(a, b)
    assert (weights[:, :2] > 4).all()
    np.testing.assert_allclose(weights[:, 2], 1, atol=1e-3)


def test_a_turn_from_one_frame_to_the_next_is_spread_and_other_joints_keep_theirs() -> None:
    n_frames, steps = 40, 20
    turns = np.repeat(Rotation.from_rotvec([0.2, 0, 0]).as_matrix()[None], n_frames, axis=0)
    turns[steps:] = Rotation.from_rotvec([0.2, 1.0, 0]).as_matrix()
    local = np.repeat(turns[:, None], COUNT, axis=1)
    steady = steady_rotations(PARENTS, local, [1], 3.0)

    def worlds(values: np.ndarray) -> np.ndarray:
        at = np.zeros((n_frames, COUNT, 3))
        return forward_kinematics(PARENTS, at[:, 0], at, values)[1]

    before, after = worlds(local), worlds(steady)
    others = [joint for joint in range(COUNT) if joint != 1]
    np.testing.assert_allclose(after[:, others], before[:, others], atol=1e-12)
    np.testing.assert_allclose(after[[0, -1], 1], before[[0, -1], 1], atol=1e-3)

    def largest_turn(values: np.ndarray) -> float:
        relative = values[:-1].swapaxes(1, 2) @ values[1:]
        return Rotation.from_matrix(relative).magnitude().max()

    assert largest_turn(after[:, 1]) < 0.25 * largest_turn(before[:, 1])


def test_joints_at_the_limit_of_contact_are_aimed_nearer_and_others_stay() -> None:
    a, b = np.zeros((3, 2, 3), np.float32), np.zeros((3, 1, 3), np.float32)
    a[:, 1, 1] = 5  # far from everything
    b[:, 0, 0] = [0.1, 0.106, 0.2]
    aim_a, aim_b = contact_targets(a, b)
    shift = 0.003 * np.exp([0, -1, -np.inf])
    np.testing.assert_allclose(aim_a[:, 0], np.outer(shift, [1, 0, 0]), atol=1e-7)
    np.testing.assert_allclose(b[:, 0] - aim_b[:, 0], np.outer(shift, [1, 0, 0]), atol=1e-7)
    np.testing.assert_array_equal(aim_a[:, 1], a[:, 1])


def test_no_frame_ends_farther_from_its_targets_than_it_began() -> None:
    """Bones much shorter than the targets want: plain Gauss-Newton steps go astray."""
    root, moved, local = pose(5, n_frames=200)
    random = np.random.default_rng(5)
    places, _ = forward_kinematics(PARENTS, root, moved, local)
    wanted = {joint: places[:, joint] for joint in range(COUNT)}
    weights = np.exp(random.normal(0, 2, (len(root), COUNT)))
    bones = moved * random.uniform(0.3, 2, (1, COUNT, 1))
    straight = np.broadcast_to(np.eye(3), local.shape)
    initial = aim_bones(PARENTS, wanted, bones, straight)

    def cost(root: np.ndarray, local: np.ndarray) -> np.ndarray:
        reached, _ = forward_kinematics(PARENTS, root, bones, local)
        return (weights * np.square(reached - places).sum(axis=-1)).sum(axis=1)

    found = inverse_kinematics(PARENTS, wanted, weights, bones, initial)
    assert (cost(*found) <= cost(*initial)).all()


def test_a_spine_of_short_bones_does_not_kink_for_millimetres() -> None:
    """Hips and shoulders held a centimetre nearer to each other than the spine is long."""
    # pelvis, four joints of the spine; hip, knee and ankle of both legs.
    parents = (-1, 0, 1, 2, 3, 0, 5, 6, 0, 8, 9)
    bones = np.array(
        [[0, 0, 0], *[[0, 0.1, 0]] * 4,
         [0.1, -0.05, 0], [0, -0.4, 0.02], [0, -0.4, -0.02],
         [-0.1, -0.05, 0], [0, -0.4, 0.02], [0, -0.4, -0.02]]
    )[None]  # fmt: skip
    local = np.broadcast_to(np.eye(3), (1, len(parents), 3, 3))
    places, _ = forward_kinematics(parents, np.zeros((1, 3)), bones, local)
    moved = places[0].copy()
    moved[1:5, 1] -= [0.001, 0.003, 0.006, 0.01]
    moved[2:4, 2] += 0.002
    wanted = {joint: moved[None, joint] for joint in range(len(parents))}
    weights = equal(wanted)
    weights[:, [4, 7, 10]] = 17
    root, found = inverse_kinematics(
        parents, wanted, weights, bones, aim_bones(parents, wanted, bones, local)
    )
    reached, _ = forward_kinematics(parents, root, bones, found)
    bends = [_bends(values)[0] for values in (moved, reached[0])]
    assert np.abs(bends[1] - bends[0]).max() < 12
    assert np.linalg.norm(reached[0] - moved, axis=-1).max() < 0.025


def _bends(places: np.ndarray) -> np.ndarray:
    """Degrees between consecutive bones of the spine."""
    bones = np.diff(places[:5], axis=0)
    lengths = np.linalg.norm(bones, axis=-1)
    cosines = (bones[1:] * bones[:-1]).sum(axis=-1) / (lengths[1:] * lengths[:-1])
    return np.degrees(np.arccos(cosines))[None]


# Of the joints above: two of them, a mid-point, and a point beyond the end of the arm.
SHARES = np.zeros((5, COUNT))
SHARES[0, 0] = SHARES[1, 2] = SHARES[2, 5] = 1
SHARES[3, [4, 6]] = 0.5
SHARES[4, [2, 3]] = -0.5, 1.5


def test_points_between_and_beyond_joints_are_met() -> None:
    root, moved, local = pose(7)
    places, _ = forward_kinematics(PARENTS, root, moved, local)
    points = PointTargets(SHARES, SHARES @ places, np.ones((len(root), len(SHARES))))
    straight = np.broadcast_to(np.eye(3), local.shape)
    known = points.of_joints()
    assert set(known) == {0, 2, 3, 5}
    for joint, found in known.items():
        np.testing.assert_allclose(found, places[:, joint], atol=1e-9)
    initial = aim_bones(PARENTS, known, moved, straight)
    found_root, found = reach_points(PARENTS, points, moved, initial)
    reached, _ = forward_kinematics(PARENTS, found_root, moved, found)
    np.testing.assert_allclose(SHARES @ reached, SHARES @ places, atol=1e-4)


def test_bones_beyond_a_joint_without_a_target_point_to_the_next_that_has_one() -> None:
    root, moved, _ = pose(8)
    turn = Rotation.from_euler("xyz", [0.8, -0.4, 2.0]).as_matrix()
    straight = np.broadcast_to(np.eye(3), (len(root), COUNT, 3, 3))
    turned = straight.copy()
    turned[:, 0] = turn
    places, _ = forward_kinematics(PARENTS, root, moved, turned)
    for joints in ((0, 3, 5), (3, 5, 6)):  # with a target of the root, and without
        wanted = {joint: places[:, joint] for joint in joints}
        found = aim_bones(PARENTS, wanted, moved, straight)
        reached, _ = forward_kinematics(PARENTS, *_posed(found, moved))
        np.testing.assert_allclose(reached, places, atol=1e-4)


@pytest.mark.parametrize("stiffness", [0.1, 3.0])
def test_stiff_joints_leave_their_rest_by_the_least_squares(stiffness: float) -> None:
    parents = (-1, 0, 1, 2, 3)
    offsets = np.array([[0.0, 0, 0], [0, 1, 0], [0, 1, 0], [0, 1, 0], [0, 1, 0]])[None]
    rest = Rotation.from_rotvec(np.outer([0.0, 0.2, -0.4, 0.1, 0], [1, 0, 0])).as_matrix()
    shares = np.eye(5)[[0, 1, 4]]
    far = np.array([[[0.0, 0, 0], [0, 1, 0], [1.2, 3.4, 0.3]]])
    stiff = dict.fromkeys((1, 2, 3), stiffness)
    targets = PointTargets(shares, far, np.ones((1, 3)), stiff, rest)
    root, found = reach_points(parents, targets, offsets, (np.zeros((1, 3)), rest[None]))

    def missed(root: np.ndarray, local: np.ndarray) -> np.ndarray:
        gaps = shares @ forward_kinematics(parents, root, offsets, local)[0] - far
        bends = Rotation.from_matrix(np.swapaxes(rest, 1, 2)[1:4] @ local[0, 1:4]).as_rotvec()
        return np.concatenate([gaps.ravel(), np.sqrt(stiffness) * bends.ravel()])

    def of_vector(x: np.ndarray) -> np.ndarray:
        turns = np.concatenate(
            [Rotation.from_rotvec(x[3:].reshape(-1, 3)).as_matrix(), np.eye(3)[None]]
        )
        return missed(x[None, :3], turns[None])

    start = Rotation.from_matrix(rest[:4]).as_rotvec().ravel()
    best = least_squares(of_vector, np.concatenate([np.zeros(3), start]))
    assert np.square(missed(root, found)).sum() <= 2 * best.cost * 1.01
