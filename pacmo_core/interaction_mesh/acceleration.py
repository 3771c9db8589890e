"""Anderson acceleration of ADMM: a step to the combination of the last iterates that moves least.

ADMM is a fixed-point iteration ``v' = T(v)``, which converges at the rate of its slowest component
(Walker and Ni (2011), *Anderson acceleration for fixed-point iterations*; for ADMM Zhang et al.
(2019), *Accelerating ADMM for efficient simulation and optimization*). Of the iterates v_1 ... v_m
and their steps f_j = v_j - v_j-1,

    v = sum a_j v_j,   a = argmin |sum a_j f_j|_P^2   with   sum a_j = 1

in the norm of the penalties P, in which T does not expand if all bounds are convex (the least
length of a bone is not). Iterates are collected anew after each
combination (Banerjee, Suryanarayana and Pask (2016), *Periodic Pulay method*): a combination in
every iteration, from iterates that are combinations, amplifies the noise of float32.
"""

import numpy as np
from numpy.typing import NDArray

from pacmo_core.interaction_mesh.scene import Array, Single

# Iterates that are combined, and so iterations between two combinations.
MEMORY = 6
# The steps are compared in every this many blocks: neighbouring frames move alike.
SAMPLE_EVERY = 4
# Of the mean square of the steps; bounds the coefficients where steps are hardly different.
REGULARISATION = 1e-6


def combine(gram: Array) -> Array:
    """Return the coefficients a, (V, M), that minimise ``a^T G a`` with sum 1.

    Parameters
    ----------
    gram : (V, M, M), products of the steps
    """
    size = gram.shape[-1]
    trace = np.trace(gram, axis1=1, axis2=2)
    ridge = REGULARISATION * trace / size
    # Without any step (a body that pads, or has arrived) the coefficients are equal.
    ridge = np.where(trace > 0, ridge, 1.0)
    regular = gram + ridge[:, None, None] * np.eye(size)
    coefficients = np.linalg.solve(regular, np.ones((len(gram), size, 1)))[..., 0]
    normalised: Array = coefficients / coefficients.sum(axis=1, keepdims=True)
    return normalised


class Iterates:
    """The last iterates of V bodies side by side, and their steps in some of the blocks.

    Parameters
    ----------
    parts : the iterate's arrays, (K, ..., V) float32 each
    penalties : (K, ..., 1) of each part, which broadcast to it
    """

    def __init__(self, parts: tuple[Single, ...], penalties: tuple[Single, ...]) -> None:
        self._roots = [np.sqrt(values[::SAMPLE_EVERY]) for values in penalties]
        self._last = [part[::SAMPLE_EVERY].copy() for part in parts]
        self._values = [np.zeros((MEMORY, *part.shape), np.float32) for part in parts]
        self._steps = [np.zeros((MEMORY, *part.shape), np.float32) for part in self._last]
        self._count = 0

    @property
    def is_full(self) -> bool:
        """Whether there are enough iterates to combine."""
        return self._count == MEMORY

    def add(self, parts: tuple[Single, ...]) -> None:
        """Add the iterate that an iteration has arrived at."""
        for index, part in enumerate(parts):
            sample, steps = part[::SAMPLE_EVERY], self._steps[index][self._count]
            np.subtract(sample, self._last[index], out=steps)
            np.multiply(steps, self._roots[index], out=steps)
            self._last[index][:] = sample
            self._values[index][self._count] = part
        self._count += 1

    def move(self, parts: tuple[Single, ...]) -> None:
        """Replace the iterate by the combination that moves least, and begin anew."""
        coefficients = combine(self._gram()).T.astype(np.float32)
        for index, part in enumerate(parts):
            values = self._values[index]
            np.multiply(values[0], coefficients[0], out=part)
            for value, coefficient in zip(values[1:], coefficients[1:], strict=True):
                value *= coefficient
                part += value
            self._last[index][:] = part[::SAMPLE_EVERY]
        self._count = 0

    def _gram(self) -> Array:
        """Return the products of the steps, (V, MEMORY, MEMORY); a body's are its own."""
        n_bodies = self._steps[0].shape[-1]
        gram = np.zeros((n_bodies, MEMORY, MEMORY))
        for steps in self._steps:
            rows = steps.reshape(MEMORY, -1, n_bodies)
            for i in range(MEMORY):
                for j in range(i + 1):
                    # Added row by row, so in one order for any number of bodies.
                    gram[:, i, j] += np.add.reduce(rows[i] * rows[j], axis=0, dtype=np.float64)
                    gram[:, j, i] = gram[:, i, j]
        return gram

    def select(self, bodies: NDArray[np.intp]) -> None:
        """Keep some of the bodies."""
        self._last = [part.take(bodies, axis=-1) for part in self._last]
        for values in (self._values, self._steps):
            values[:] = [self._select_added(part, bodies) for part in values]

    def _select_added(self, values: Single, bodies: NDArray[np.intp]) -> Single:
        selected = np.zeros((*values.shape[:-1], len(bodies)), np.float32)
        values[: self._count].take(bodies, axis=-1, out=selected[: self._count], mode="clip")
        return selected
