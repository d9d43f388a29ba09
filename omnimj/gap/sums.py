"""Sums of products over many rows, compiled: a library's threads only wait for each other on these."""

from __future__ import annotations

import numpy as np

from omnimj.physics.native import kernel


@kernel
def weighted_sums(jacobian, residual, weight):
    """[J r]ᵀ W² [J r].

    Args:
      jacobian: J, shape (rows, parameters).
      residual: r, shape (rows,).
      weight: Diagonal of W, shape (rows,).

    Returns:
      Shape (parameters + 1, parameters + 1).
    """
    rows, n = jacobian.shape
    sums = np.zeros((n + 1, n + 1))
    row = np.empty(n + 1)
    for k in range(rows):
        w = weight[k]
        if w == 0.0:
            continue
        for i in range(n):
            row[i] = w * jacobian[k, i]
        row[n] = w * residual[k]
        for i in range(n + 1):
            value = row[i]
            for j in range(n + 1):
                sums[i, j] += value * row[j]
    return sums
