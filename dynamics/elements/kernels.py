"""Compiled material laws of linear tetrahedra, and loops over patches of tetrahedra.

With the deformation gradient F of an element and Lamé's constants mu and lambda, the energy per rest volume [J/m³] is

    linear        mu |sym F - I|²                        theta = tr F - 3
    corotated     mu |F - R|²                            theta = R : F - 3, R the rotation of F
    neo-Hookean   mu ((|F|² - 3) / 2 - ln det F)         theta = det F - 1

plus, for each patch, lambda / 2 times the square of the mean of theta over it. The mean prevents locking of nearly
incompressible elements. Dashpots with moduli mu' and lambda' add two stresses. The first is A (2 mu' sym(A^T dF/dt)),
with A = I in the linear law and A = F in the other laws. The second is lambda' times the mean rate of theta. Sources:
[mcadams2011] corotated law, [lin2022] rotation R, [bonet2008] neo-Hookean law, [souzaneto2005] patches.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numba.extending import register_jitable

from dynamics.arrays import Floats

LINEAR, COROTATED, NEO_HOOKEAN = range(3)

FASTMATH = {"contract", "reassoc", "nsz", "arcp"}
"""Reorderings of sums that the compiler may apply; NaN and infinity keep their meaning."""

NEWTON = 30
"""Largest number of iterations for the sum of principal stretches. Five suffice if no element is near inversion."""


class PackedTetrahedra(NamedTuple):
    """Elements in the order of the kernels, patch by patch.

    starts: index of the first element of each patch, then the number of elements, (n_patches + 1,)
    corners: index of each corner among its patch's nodes, (m, 4); volumes: volumes at rest [m³], (m,)
    gradients: gradients of the corners' barycentric weights [1/m], (m, 4, 3)
    """

    starts: np.ndarray
    corners: np.ndarray
    volumes: Floats
    gradients: Floats


class _Scratch(NamedTuple):
    """Scratch arrays for one element.

    F, rate: deformation gradient and its rate; A: as in the module's docstring; P: stress divided by mu
    T: derivative of theta with respect to F; M: intermediate results; cofactors: cofactors of F
    inverse: (tr V I - V)^-1 for the stretch V = F R'. These arrays have the shape (3, 3).
    h: gradients of the corners' weights, multiplied by R (in the neo-Hookean law, by F^-T), (4, 3)
    """

    F: Floats
    rate: Floats
    A: Floats
    P: Floats
    T: Floats
    M: Floats
    cofactors: Floats
    inverse: Floats
    h: Floats


@register_jitable
def _scratch():  # type: ignore[no-untyped-def]
    a = np.zeros((8, 3, 3))
    return _Scratch(a[0], a[1], a[2], a[3], a[4], a[5], a[6], a[7], np.zeros((4, 3)))


@register_jitable
def _cofactors(F, out):  # type: ignore[no-untyped-def]
    """Write the cofactors of F into `out`, and return the determinant of F."""
    for i in range(3):
        for j in range(3):
            a, b, c, d = (i + 1) % 3, (i + 2) % 3, (j + 1) % 3, (j + 2) % 3
            out[i, j] = F[a, c] * F[b, d] - F[a, d] * F[b, c]
    return F[0, 0] * out[0, 0] + F[0, 1] * out[0, 1] + F[0, 2] * out[0, 2]


@register_jitable
def _double_dot(A, B):  # type: ignore[no-untyped-def]
    total = 0.0
    for i in range(3):
        for j in range(3):
            total += A[i, j] * B[i, j]
    return total


@register_jitable
def _transposed_product(A, B, out):  # type: ignore[no-untyped-def]
    """Write A' B into `out`."""
    for i in range(3):
        for j in range(3):
            out[i, j] = A[0, i] * B[0, j] + A[1, i] * B[1, j] + A[2, i] * B[2, j]


@register_jitable
def _rotation(F, cofactors, det, M, R):  # type: ignore[no-untyped-def]
    """Write the rotation of F into R; M: array for intermediate results.

    The rotation is the derivative of the sum s of the principal stretches with respect to F. The sum s is the largest
    root of `(s² - |F|²)² - 8 det F s - 4 |cof F|²`. Newton's method starts above this root.
    """
    square, of_cofactors = _double_dot(F, F), _double_dot(cofactors, cofactors)
    s = np.sqrt(3.0 * square)
    for _ in range(NEWTON):
        q = s * s - square
        slope = 4.0 * s * q - 8.0 * det
        step = (q * q - 8.0 * det * s - 4.0 * of_cofactors) / slope
        s -= step
        if not step > 1e-15 * s:
            break
    _transposed_product(F, F, M)
    by = 1.0 / (s * (s * s - square) - 2.0 * det)
    for i in range(3):
        for j in range(3):
            cubed = F[i, 0] * M[0, j] + F[i, 1] * M[1, j] + F[i, 2] * M[2, j]
            R[i, j] = by * ((s * s + square) * F[i, j] + 2.0 * s * cofactors[i, j] - 2.0 * cubed)


@register_jitable
def _state(law, e, x, v, p, s):  # type: ignore[no-untyped-def]
    """Energy density of element e divided by mu, and theta (see the module). Fills `s` except its `h` and `inverse`.

    x, v: positions and velocities of the nodes on which the element's energy depends, (n, 3)
    """
    F, T = s.F, s.T
    for i in range(3):
        for j in range(3):
            F[i, j], s.rate[i, j], s.A[i, j] = 0.0, 0.0, 1.0 if i == j else 0.0
    for a in range(4):
        c = p.corners[e, a]
        for i in range(3):
            for j in range(3):
                F[i, j] += x[c, i] * p.gradients[e, a, j]
                s.rate[i, j] += v[c, i] * p.gradients[e, a, j]
    if law == LINEAR:
        for i in range(3):
            for j in range(3):
                T[i, j] = s.A[i, j]
                s.P[i, j] = F[i, j] + F[j, i] - 2.0 * T[i, j]
        return 0.25 * _double_dot(s.P, s.P), F[0, 0] + F[1, 1] + F[2, 2] - 3.0
    for i in range(3):
        for j in range(3):
            s.A[i, j] = F[i, j]
    det = _cofactors(F, s.cofactors)
    if law == NEO_HOOKEAN:
        by = 1.0 / det if det > 0.0 else np.nan
        for i in range(3):
            for j in range(3):
                T[i, j] = s.cofactors[i, j]
                s.P[i, j] = F[i, j] - by * T[i, j]
        return 0.5 * (_double_dot(F, F) - 3.0) - np.log(det) if det > 0.0 else np.inf, det - 1.0
    _rotation(F, s.cofactors, det, s.M, T)
    for i in range(3):
        for j in range(3):
            s.P[i, j] = 2.0 * (F[i, j] - T[i, j])
    return 0.25 * _double_dot(s.P, s.P), _double_dot(F, T) - 3.0


@register_jitable
def _slopes(law, e, p, s):  # type: ignore[no-untyped-def]
    """Write `s.h` and, for the corotated law, `s.inverse`. Returns det F for the neo-Hookean law, otherwise 0."""
    det = _double_dot(s.T, s.F) / 3.0 if law == NEO_HOOKEAN else 0.0
    by = 1.0 / det if law == NEO_HOOKEAN else 1.0
    for a in range(4):
        for i in range(3):
            s.h[a, i] = 0.0
            for j in range(3):
                s.h[a, i] += by * s.T[i, j] * p.gradients[e, a, j]
    if law == COROTATED:
        for i in range(3):
            for j in range(3):
                s.M[i, j] = 0.0
                for k in range(3):
                    s.M[i, j] -= 0.5 * (s.F[i, k] * s.T[j, k] + s.F[j, k] * s.T[i, k])
        trace = s.M[0, 0] + s.M[1, 1] + s.M[2, 2]
        for i in range(3):
            s.M[i, i] -= trace
        by = 1.0 / _cofactors(s.M, s.inverse)
        for i in range(3):
            for j in range(3):
                s.inverse[i, j] *= by
    return det


@register_jitable
def _turning(a, b, s, out):  # type: ignore[no-untyped-def]
    """Write `[h_a]' inverse [h_b]` into `out`: derivative of h_a by the position of corner b; `[h] y = h × y`."""
    for j in range(3):
        k, m = (j + 1) % 3, (j + 2) % 3
        # h_b x e_j has the components k: h_m, m: -h_k
        y0 = s.inverse[0, k] * s.h[b, m] - s.inverse[0, m] * s.h[b, k]
        y1 = s.inverse[1, k] * s.h[b, m] - s.inverse[1, m] * s.h[b, k]
        y2 = s.inverse[2, k] * s.h[b, m] - s.inverse[2, m] * s.h[b, k]
        out[0, j] = y1 * s.h[a, 2] - y2 * s.h[a, 1]
        out[1, j] = y2 * s.h[a, 0] - y0 * s.h[a, 2]
        out[2, j] = y0 * s.h[a, 1] - y1 * s.h[a, 0]


@njit(cache=True, nogil=True, fastmath=FASTMATH, error_model="numpy")
def tetrahedra_forces(x, v, law, p, moduli, energy, force):  # type: ignore[no-untyped-def]
    """Write the energy of each patch [J] to `energy`, (n_patches,), and add the forces on its nodes to `force`.

    x, v, force: positions, velocities and forces [N] of the nodes of each patch, (n_patches, n_corners, 3)
    moduli: lambda, mu [Pa], lambda', mu' [Pa s] of each tetrahedron, (m, 4)
    """
    s = _scratch()
    for q in range(len(x)):
        bulk, strain, rate, energy[q] = 0.0, 0.0, 0.0, 0.0
        slope = np.zeros(x.shape[1:])
        total, viscous = 0.0, 0.0
        for e in range(p.starts[q], p.starts[q + 1]):
            volume = p.volumes[e]
            by_mu, theta = _state(law, e, x[q], v[q], p, s)
            energy[q] += volume * moduli[e, 1] * by_mu
            total += volume
            bulk += volume * moduli[e, 0]
            viscous += volume * moduli[e, 2]
            strain += volume * theta
            rate += volume * _double_dot(s.T, s.rate)
            for i in range(3):
                for j in range(3):
                    s.P[i, j] *= moduli[e, 1]
            _transposed_product(s.A, s.rate, s.M)
            for i in range(3):
                for j in range(3):
                    for k in range(3):
                        s.P[i, j] += moduli[e, 3] * s.A[i, k] * (s.M[k, j] + s.M[j, k])
            for a in range(4):
                c = p.corners[e, a]
                for i in range(3):
                    for j in range(3):
                        force[q, c, i] -= volume * s.P[i, j] * p.gradients[e, a, j]
                        slope[c, i] += volume * s.T[i, j] * p.gradients[e, a, j]
        strain, rate = strain / total, rate / total
        energy[q] += 0.5 * bulk * strain * strain
        pressure = (bulk * strain + viscous * rate) / total
        for c in range(x.shape[1]):
            for i in range(3):
                force[q, c, i] -= pressure * slope[c, i]


@njit(cache=True, nogil=True, fastmath=FASTMATH, error_model="numpy")
def tetrahedra_tangents(x, v, law, p, moduli, K, C):  # type: ignore[no-untyped-def]
    """Add stiffness to K and damping to C, (n_patches, n_corners, 3, n_corners, 3) each."""
    s, n = _scratch(), x.shape[1]
    turned, left, mixed = np.zeros((3, 3)), np.zeros((3, 3)), np.zeros((3, 3))
    B, fast = np.zeros((4, 3)), np.zeros((4, 3))
    slope, turning = np.empty((n, 3)), np.empty((n, 3))
    for q in range(len(x)):
        total, bulk, viscous, strain, rate = 0.0, 0.0, 0.0, 0.0, 0.0
        slope[:], turning[:] = 0.0, 0.0
        for e in range(p.starts[q], p.starts[q + 1]):
            volume = p.volumes[e]
            _, theta = _state(law, e, x[q], v[q], p, s)
            total += volume
            bulk += volume * moduli[e, 0]
            viscous += volume * moduli[e, 2]
            strain += volume * theta
            rate += volume * _double_dot(s.T, s.rate)
            for a in range(4):
                for i in range(3):
                    for j in range(3):
                        slope[p.corners[e, a], i] += volume * s.T[i, j] * p.gradients[e, a, j]
        pressure = (bulk * strain + viscous * rate) / (total * total)
        for e in range(p.starts[q], p.starts[q + 1]):
            volume, mu, dashpot = p.volumes[e], moduli[e, 1], moduli[e, 3]
            _state(law, e, x[q], v[q], p, s)
            det = _slopes(law, e, p, s)
            _transposed_product(s.A, s.rate, s.M)
            for i in range(3):
                for a in range(4):
                    B[a, i], fast[a, i] = 0.0, 0.0
                    for k in range(3):
                        B[a, i] += s.A[i, k] * p.gradients[e, a, k]
                        fast[a, i] += s.rate[i, k] * p.gradients[e, a, k]
                for j in range(3):
                    left[i, j], mixed[i, j] = 0.0, 0.0
                    for k in range(3):
                        left[i, j] += s.A[i, k] * s.A[j, k]
                        mixed[i, j] += s.A[i, k] * s.rate[j, k]
            moves = 0.0 if law == LINEAR else dashpot
            for a in range(4):
                row = p.corners[e, a]
                for b in range(4):
                    column = p.corners[e, b]
                    dot, stretching = 0.0, 0.0
                    for k in range(3):
                        dot += p.gradients[e, a, k] * p.gradients[e, b, k]
                        for m in range(3):
                            product = p.gradients[e, a, k] * p.gradients[e, b, m]
                            stretching += product * (s.M[k, m] + s.M[m, k])
                    if law == COROTATED:
                        _turning(a, b, s, turned)
                    for i in range(3):
                        for j in range(3):
                            of_theta, of_shear = turned[i, j], -2.0 * turned[i, j]
                            if law != COROTATED:
                                of_shear = s.h[b, i] * s.h[a, j]
                                of_theta = det * (s.h[a, i] * s.h[b, j] - of_shear)
                            entry = mu * of_shear + pressure * of_theta
                            entry += moves * (B[b, i] * fast[a, j] + mixed[i, j] * dot)
                            K[q, row, i, column, j] += volume * entry
                            C[q, row, i, column, j] += volume * dashpot * (left[i, j] * dot + B[b, i] * B[a, j])
                            turning[row, i] += volume * of_theta * v[q, column, j]
                        by = 2.0 * mu if law == COROTATED else mu
                        K[q, row, i, column, i] += volume * (by * dot + moves * stretching)
        for a in range(n):
            for i in range(3):
                by = slope[a, i] / (total * total)
                for b in range(n):
                    for j in range(3):
                        K[q, a, i, b, j] += by * (bulk * slope[b, j] + viscous * turning[b, j])
                        C[q, a, i, b, j] += by * viscous * slope[b, j]
