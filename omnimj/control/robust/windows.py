"""Sudden changes of the force channel: likelihood ratios over the last 0.05 … 1 s.

Over a window of whitened blocks ρ = X θ + noise with θ ~ N(θ̂, P) as learnt before the window. One more number
d along column j of X (a jump of δ_j, ν_j or β_j) is found and weighed with everything else free:
  S = x_jᵀ V⁻¹ (ρ − X θ̂),  N = x_jᵀ V⁻¹ x_j,  V = I + X P Xᵀ;  d̂ = S/N,  2 Λ = d̂ (2 S − d̂ N),
by Woodbury's identity from the sums XᵀX and Xᵀ(ρ − X θ̂) alone. What the jump leaves unexplained tells how
large the noise of this window was: Λ is divided by it where it is above 1.
"""

from __future__ import annotations

import numpy as np

from omnimj.physics.native import kernel

WINDOWS = (5, 10, 20, 50, 100)
"""Lengths [blocks]."""
LONGEST = WINDOWS[-1]
_LENGTHS = np.array(WINDOWS)

LIKELIHOOD, SIZE, DEVIATION, WINDOW = range(4)
"""Of one hypothesis: Λ [nats], d̂, its standard deviation, length of the window that says it [blocks]."""
SCORE = 4


@kernel
def scores(ring, filled, head, theta, precision, low, high, found):
    """Fills `found`, shape (2n+2, SCORE), with the best window of each jump: δ, ν, β.

    Args:
      ring: Whitened blocks, rows of [X (3 p) | ρ (3)], shape (LONGEST, 3 (p + 1)).
      filled: Blocks in it.
      head: Row of the newest block.
      theta: θ̂ before the window, shape (p,).
      precision: P⁻¹, shape (p, p).
      low: Least d per hypothesis, shape (2n+2,).
      high: Largest d, shape (2n+2,).
      found: Output.

    Returns:
      Σ of squares of ρ − X θ̂ over the longest window and over each, shape (windows,), per its 3 m numbers.
    """
    p = theta.size
    gram, pulled = np.zeros((p, p)), np.zeros(p)
    misfit = np.zeros(len(_LENGTHS))
    squares = 0.0
    found[:, :] = 0.0
    row, window = head, 0
    for m in range(filled):
        block = ring[row]
        for k in range(3):
            away = block[3 * p + k]
            x = block[k * p : (k + 1) * p]
            for j in range(p):
                away -= x[j] * theta[j]
            squares += away * away
            for j in range(p):
                if x[j] != 0.0:
                    pulled[j] += x[j] * away
                    for q in range(j + 1):
                        gram[j, q] += x[j] * x[q]
        row = row - 1 if row > 0 else ring.shape[0] - 1
        if m + 1 == _LENGTHS[window]:
            misfit[window] = squares / (3.0 * (m + 1))
            _weigh(gram, pulled, squares, precision, low, high, float(m + 1), found)
            window += 1
            if window == len(_LENGTHS):
                break
    return misfit


@kernel
def _weigh(gram, pulled, squares, precision, low, high, length, found):
    """Every hypothesis at one window; keeps the better of this and what was found at shorter ones."""
    p = pulled.size
    whole = np.empty((p, p))
    for j in range(p):
        for q in range(j + 1):
            whole[j, q] = precision[j, q] + gram[j, q]
            whole[q, j] = whole[j, q]
    chol = np.linalg.cholesky(whole)
    solved = np.empty(p)
    side = np.empty(p)
    forward(chol, pulled, solved)
    for h in range(low.size):
        for j in range(p):
            side[j] = gram[h, j] if j <= h else gram[j, h]
        column = side[h]
        score = pulled[h]
        forward(chol, side, side)
        for j in range(p):
            score -= side[j] * solved[j]
            column -= side[j] * side[j]
        if column <= 1e-6:
            continue
        size = min(max(score / column, low[h]), high[h])
        likelihood = 0.5 * size * (2.0 * score - size * column)
        left = squares - size * (2.0 * pulled[h] - size * gram[h, h])
        likelihood /= max(1.0, left / (3.0 * length))
        if likelihood > found[h, LIKELIHOOD]:
            found[h, LIKELIHOOD], found[h, SIZE] = likelihood, size
            found[h, DEVIATION], found[h, WINDOW] = column**-0.5, length


@kernel
def forward(chol, right, out):
    """L y = b by substitution; `out` may be `right`."""
    for j in range(right.size):
        value = right[j]
        for q in range(j):
            value -= chol[j, q] * out[q]
        out[j] = value / chol[j, j]
