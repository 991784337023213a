"""Nodes that move as one rigid body: three displacements, three rotations as arc lengths on its rim.

The last of the nodes (t, 3) is where the displacements are taken; without nodes there are no motions.
"""

import numpy as np

from data.signal import Array


def _arms(nodes: Array) -> tuple[Array, float]:
    """Return the nodes' arms (t, 3) [m], and the length that makes rotations arc lengths [m]."""
    arms = nodes - nodes[-1]
    return arms, float(np.linalg.norm(arms, axis=1).max())


def motions(nodes: Array) -> Array:
    """Return d(positions) / d(the six unknowns), (3t, 6); (0, 0) without nodes."""
    if not len(nodes):
        return np.zeros((0, 0))
    arms, size = _arms(nodes)
    turns = [np.cross(axis, arms) / size for axis in np.eye(3)]
    shifts = [np.broadcast_to(axis, arms.shape) for axis in np.eye(3)]
    return np.stack([m.ravel() for m in (*shifts, *turns)], axis=1)


def moved(nodes: Array, unknowns: Array) -> Array:
    """Return the nodes after a finite motion by the six unknowns [m]."""
    arms, size = _arms(nodes)
    return np.asarray(nodes[-1] + unknowns[:3] + arms @ rotation(unknowns[3:] / size).T)


def fitted(nodes: Array, near: Array) -> Array:
    """Return nodes (t, 3) after the rigid motion that brings them nearest to other places (t, 3)."""
    if not len(nodes):
        return nodes
    middle, there = nodes.mean(axis=0), near.mean(axis=0)
    u, _, v = np.linalg.svd((near - there).T @ (nodes - middle))
    u[:, 2] *= np.sign(np.linalg.det(u @ v))  # plane nodes leave the third direction open
    return np.asarray((nodes - middle) @ (u @ v).T + there)


def turning(nodes: Array, forces: Array) -> Array:
    """Return the stiffness (3, 3) that forces (t, 3) have against rotations [N/m].

    Its skew part is the moment of the forces, 0 at equilibrium, and left out.
    """
    arms, size = _arms(nodes)
    turn = forces.T @ arms
    return np.asarray(((turn + turn.T) / 2 - np.trace(turn) * np.eye(3)) / size**2)


def rotation(vector: Array) -> Array:
    """Return the rotation matrix (3, 3) of a rotation vector (3,) [rad] (Rodrigues)."""
    angle = float(np.linalg.norm(vector))
    x, y, z = vector
    k = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.asarray(np.eye(3) + np.sinc(angle / np.pi) * k + 0.5 * np.sinc(angle / 2 / np.pi) ** 2 * (k @ k))
