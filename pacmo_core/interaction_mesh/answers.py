"""How the two bodies answer, at first, when one bone grows: where the solver starts.

Near the source the best motion is linear in the scales: least E(U) where every bone gets its
length along the direction that it has. What is free are two ways for each bone to turn and three
for each root, so that one block elimination, frames in pairs, tells the answer to each bone; the
start for any body is a sum of these. As it serves the solver as a start only, it may be computed
for one part of a long motion after the other, and for fewer frames a second than there are.
"""

from dataclasses import dataclass

import numpy as np

from pacmo_core.interaction_mesh.energy import Quadratic, forces, target_of
from pacmo_core.interaction_mesh.freedoms import freedoms, least, times
from pacmo_core.interaction_mesh.products import product
from pacmo_core.interaction_mesh.scene import Array, Scene, Single

# Frames a second, about, for which answers are computed: with half as many, single bones start so
# far off that they end 3 % above the least energy.
RATE = 30
# Such frames of a part, and of its neighbours that are looked at beside it.
PART = 480
BESIDE = 40


@dataclass(frozen=True)
class Answers:
    """What a bone of twice its length would do, were the answer linear.

    Parameters
    ----------
    leap : frames from one of the F for which this is known to the next
    turns : (F, E, 3, E) float32 metres, by which the ends of bones go sideways
    tensions : (F, E, E) float32, the forces along bones
    """

    leap: int
    turns: Single
    tensions: Single

    def summed(self, vectors: Array, scales: Array, bearing: Single) -> Single:
        """``(T, E, 3, V)`` metres: bones turned and pulled longer by what bears on them.

        Parameters
        ----------
        vectors : (T, E, 3) metres, the source's bones
        scales : (V, E)
        bearing : (T, E, 1), penalties
        """
        source = vectors.astype(np.float32)
        growth = np.ascontiguousarray(scales.T - 1).astype(np.float32)
        turned = product(self.turns.reshape(-1, len(growth)), growth)
        bones = self._between(turned.reshape(*self.turns.shape[:3], -1), len(source))
        bones += source[..., None] * (1 + growth)[:, None]
        lengths = np.linalg.norm(source, axis=-1)[..., None] * (1 + growth)
        borne = product(self.tensions.reshape(-1, len(growth)), growth)
        borne = self._between(borne.reshape(*self.tensions.shape[:2], -1), len(source))
        lengths += borne / bearing
        bones *= (lengths / np.sqrt(np.einsum("tecv,tecv->tev", bones, bones)))[:, :, None]
        return bones

    def _between(self, known: Single, n_frames: int) -> Single:
        """Fill in frames between those for which something is known, (F, ...)."""
        if self.leap == 1:
            return known
        before, beyond = np.divmod(np.arange(n_frames), self.leap)
        after = np.minimum(before + 1, len(known) - 1)
        share = (beyond / self.leap).astype(np.float32).reshape(-1, *[1] * (known.ndim - 1))
        found: Single = known[before]
        found += share * (known[after] - found)
        return found


def answers(scene: Scene, energy: Quadratic) -> Answers:
    """Compute the answers to every bone, part by part."""
    leap = max(1, round(scene.fps / RATE))
    n_frames, n_bones = -(-len(scene.vectors) // leap), scene.vectors.shape[1]
    turns = np.zeros((n_frames, n_bones, 3, n_bones), dtype=np.float32)
    tensions = np.zeros((n_frames, n_bones, n_bones), dtype=np.float32)
    for first in range(0, n_frames, PART):
        begin, end = max(0, first - BESIDE), first + PART + BESIDE
        part = _of_part(scene, energy, slice(begin * leap, end * leap, leap))
        own = slice(first - begin, first - begin + PART)
        turns[first : first + PART], tensions[first : first + PART] = (x[own] for x in part)
    return Answers(leap, turns, tensions)


def _of_part(scene: Scene, whole: Quadratic, frames: slice) -> tuple[Single, Single]:
    """Give turns and tensions of some frames."""
    energy, vectors = whole.part(frames), scene.vectors[frames].astype(np.float32)
    n_bones = vectors.shape[1]
    free = freedoms(scene, vectors)
    # Each bone twice as long where it points, all else in place.
    grown = free.reach[:, None, :n_bones] * vectors.transpose(0, 2, 1)[:, None]
    pull = target_of(energy, np.eye(n_bones) + 1).astype(np.float32)
    pull = times(energy.laplacians.transpose(0, 2, 1).astype(np.float32), pull)
    right = free.gather(pull - forces(energy, grown))
    moves = free.vectors(least(energy, free, right))
    left = pull - forces(energy, grown + times(free.reach, moves))
    left = times(free.reach.T[:n_bones], left)
    along = vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)
    return moves[:, :n_bones], np.einsum("tec,tecv->tev", along, left)
