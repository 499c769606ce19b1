"""What goes before and after `cluster_information` where thousands of torquing plans are tried.

A plan is a list of rates held for whole numbers of equal slots. The information pass is called from
outside and not from a kernel here: compiled into another kernel its sums come out in another order
than where that kernel is loaded from the cache, and the same plan would have two costs.
"""

import math

import numpy as np

from foucault.kernels import kernel
from foucault.kernels.rotation import multiply_exp
from foucault.kernels.small_matrices import cholesky

KNOWN = 45
"""Attitude at the start 3, constants 42."""


@kernel
def commanded(rates, slots, slot, C_pn, w_in):
    """Return the open-loop command of a plan in each slot, shape (sum(slots), 3) [rad/s].

    Parameters: rates (k, 3) of the cluster relative to n, frame p [rad/s]; slots (k,) of each;
    slot [s]; C_pn (3, 3) planned attitude at the start; w_in (3,) Earth's rate in n [rad/s].
    """
    out = np.empty((slots.sum(), 3))
    C = C_pn.T.copy()  # maps p to n, so that a turn of p multiplies from the right
    at = 0
    for k in range(slots.size):
        x, y, z = rates[k, 0], rates[k, 1], rates[k, 2]
        h = 0.5 * slot
        for _ in range(slots[k]):
            multiply_exp(C, x * h, y * h, z * h)
            for i in range(3):
                out[at, i] = rates[k, i] + C[0, i] * w_in[0] + C[1, i] * w_in[1] + C[2, i] * w_in[2]
            multiply_exp(C, x * h, y * h, z * h)
            at += 1
    return out


@kernel
def attitudes(rates, slots, slot, C_pn):
    """Return the planned attitude C_pn at the ends of the slots, shape (1 + sum(slots), 3, 3)."""
    out = np.empty((slots.sum() + 1, 3, 3))
    C = C_pn.T.copy()
    out[0] = C_pn
    at = 0
    for k in range(slots.size):
        for _ in range(slots[k]):
            multiply_exp(C, rates[k, 0] * slot, rates[k, 1] * slot, rates[k, 2] * slot)
            at += 1
            out[at] = C.T
    return out


@kernel
def remaining(N):
    """Return sd over prior sd of every unknown, shape (45,).

    N (45, 45), the information, lower half, is used up; the prior is the unit matrix; all NaN where
    N is no sum of squares.
    """
    sd = np.full(KNOWN, np.nan)
    for i in range(KNOWN):
        N[i, i] += 1.0
    if not cholesky(N, KNOWN):
        return sd
    column = np.empty(KNOWN)
    for j in range(KNOWN):  # column j of inv(L): its squares add to entry (j, j) of the inverse
        s2 = N[j, j] * N[j, j]
        column[j] = N[j, j]
        for i in range(j + 1, KNOWN):
            s = 0.0
            for k in range(j, i):
                s -= N[i, k] * column[k]
            column[i] = s * N[i, i]
            s2 += column[i] * column[i]
        sd[j] = math.sqrt(s2)
    return sd
