"""Sudden changes of the force channel: generalised likelihood ratios (GLR) over the last 0.05 … 1 s.

Over the last second of whitened blocks ρ = X θ + noise with θ ~ N(θ̂, P) as learnt before it. A jump d of
one parameter along column j of X (δ_j, ν_j or β_j), x_j in the newest blocks, the window, and 0 before it, is
estimated and weighed with everything else free:
  S = x_jᵀ V⁻¹ (ρ − X θ̂),  N = x_jᵀ V⁻¹ x_j,  V = I + X P Xᵀ;  d̂ = S/N,  2 Λ = d̂ (2 S − d̂ N),
by Woodbury's identity from the sums XᵀX and Xᵀ(ρ − X θ̂) of the second and of the windows alone. So the
blocks before a window show the robot as it was a moment ago: without them an unknown payload would pass for
most of a weak motor. The misfit that the jump leaves in its window estimates the noise there: Λ is divided by
it where it is above 1.

That holds for noise that is white from block to block. Rollers and gears ripple with the angle of the wheel;
such noise is coloured, and Λ is large again and again without any fault. So Λ is also divided by its own
usual level of the last 10 s where that exceeds the level of white noise: a test with a constant rate of false
alarms (CFAR; H. Rohling, Radar CFAR thresholding in clutter, IEEE Trans. AES 19, 1983).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from omnimj.physics.native import kernel
from omnimj.signals import Array

WINDOWS = (5, 10, 20, 50, 100)
"""Lengths [blocks]."""
LONGEST_WINDOW = WINDOWS[-1]
_LENGTHS = np.array(WINDOWS)
_WHOLE = len(WINDOWS) - 1  # the longest window is the whole second
_RATHER = 2.0  # [nats] by which friction must be more likely than a loss
FILLED, HEAD, RENEWED, COUNTED = range(4)
"""Places of `BlockHistory.cursor`: blocks in the ring, row of the newest one, window whose sums are being
renewed, and blocks in its new sums."""
USUAL = 1.5
"""Mean of the largest Λ of a block that the noise of the model file's sensors makes at most [nats]."""
USUAL_BLOCKS, USUAL_WEIGHT = 900.0, 100.0
"""Blocks over which the usual level is averaged, and how many of them `USUAL` is worth at the start."""


class BlockHistory(NamedTuple):
    """Whitened blocks of the last second."""

    ring: Array
    """Rows of [X (3 p) | ρ (3) | column of γ to learn from (3)], shape (LONGEST_WINDOW, 3 (p + 2))."""
    cursor: Array
    """By `FILLED`, `HEAD`, `RENEWED`, `COUNTED`, shape (4,), integers."""
    largest: Array
    """Largest Λ of each block by the law of white noise, shape (LONGEST_WINDOW,) [nats]."""
    gram: Array
    """XᵀX below the diagonal over each window and, last, of the sums that are being renewed, shape
    (windows+1, p, p)."""
    pull: Array
    """Xᵀ ρ, shape (windows+1, p)."""
    squares: Array
    """ρᵀ ρ, shape (windows+1,)."""


class JumpScores(NamedTuple):
    """Best window of every hypothesis δ, ν, β, all of shape (2n+2,)."""

    likelihood: Array
    """Λ [nats]."""
    size: Array
    """d̂ [1, 1, m/s²]."""
    deviation: Array
    """Standard deviation of d̂."""
    window: Array
    """Length of the window [blocks]."""


def is_friction(loss: float, friction: float) -> bool:
    """True if an added friction explains a missing force rather than a loss of torque constant.

    Args:
      loss: Λ of the loss [nats].
      friction: Λ of the friction on the same wheel [nats].
    """
    return friction > loss + _RATHER


class _Residuals(NamedTuple):
    """Sums of r = ρ − X θ̂ over each window."""

    pull: Array
    """Xᵀ r, shape (windows, p)."""
    squares: Array
    """rᵀ r, shape (windows,)."""


class _Jumps(NamedTuple):
    """Jump of every hypothesis at every window, its misfit aside, shape (windows, 2n+2) each."""

    likelihood: Array
    """Λ of white noise [nats]; 0 where a window shows nothing."""
    size: Array
    """d̂ [1, 1, m/s²]."""
    information: Array
    """N, the inverse of the variance of d̂."""


def initial_history(columns: int) -> BlockHistory:
    """Empty history for θ of length p."""
    p, sums = columns, len(WINDOWS) + 1
    return BlockHistory(
        np.zeros((LONGEST_WINDOW, 3 * (p + 2))),
        np.array([0, -1, 0, 0]),
        np.zeros(LONGEST_WINDOW),
        np.zeros((sums, p, p)),
        np.zeros((sums, p)),
        np.zeros(sums),
    )


def no_scores(wheels: int) -> JumpScores:
    """Scores of n wheels before the first block."""
    h = 2 * wheels + 2
    return JumpScores(np.zeros(h), np.zeros(h), np.zeros(h), np.zeros(h))


@kernel
def update_usual_level(usual, largest):
    """Take the largest Λ of one block into the usual level, in place.

    Args:
      usual: Level [nats] and number of blocks in it, shape (2,).
      largest: Λ of the block [nats].
    """
    usual[0] += (largest - usual[0]) / (usual[1] + 1.0 + USUAL_WEIGHT)
    usual[1] = min(usual[1] + 1.0, USUAL_BLOCKS)


@kernel
def coloured_variance(usual):
    """Variance of the noise in sums over windows, in units of that of white noise, at least 1.

    Λ of a jump is a square of such a sum over its variance without any fault, so that its mean is in
    proportion to the true variance.

    Args:
      usual: From `update_usual_level`, shape (2,).
    """
    return max(1.0, usual[0] / USUAL)


@kernel
def clear_scores(scores):
    """Scores without any jump, in place."""
    scores.likelihood[:] = 0.0
    scores.size[:] = 0.0
    scores.deviation[:] = 0.0
    scores.window[:] = 0.0


@kernel
def push_block(history, row):
    """Push a block into the history, in place: its oldest block drops out once it is full.

    Sums over windows gain the new block and lose the one that leaves. What rounding leaves behind does not
    grow: one window after the other, sums that have only ever gained replace those that have lost.

    Args:
      history: `BlockHistory`, changed in place.
      row: Row of `BlockHistory.ring`.
    """
    ring, cursor, sums = history.ring, history.cursor, history.squares.size
    filled, head, new = cursor[FILLED], cursor[HEAD], sums - 1
    if filled == 0:
        history.gram[:], history.pull[:], history.squares[:] = 0.0, 0.0, 0.0
        cursor[RENEWED], cursor[COUNTED] = 0, 0
    for w in range(sums):
        if w < new and filled >= _LENGTHS[w]:
            _add_block(history, w, ring[(head + 1 - _LENGTHS[w]) % ring.shape[0]], -1.0)
        _add_block(history, w, row, 1.0)
    cursor[HEAD] = (head + 1) % ring.shape[0]
    cursor[FILLED] = min(filled + 1, ring.shape[0])
    cursor[COUNTED] += 1
    ring[cursor[HEAD]] = row
    w = cursor[RENEWED]
    if cursor[COUNTED] == _LENGTHS[w]:
        history.gram[w], history.pull[w] = history.gram[new], history.pull[new]
        history.squares[w] = history.squares[new]
        history.gram[new], history.pull[new], history.squares[new] = 0.0, 0.0, 0.0
        cursor[RENEWED], cursor[COUNTED] = (w + 1) % new, 0


@kernel
def _add_block(history, window, block, sign):
    """Add a block to the sums of a window, or take it out where the sign is −1, in place."""
    gram, pull = history.gram[window], history.pull[window]
    p = pull.size
    r_x, r_y, r_z = sign * block[3 * p], sign * block[3 * p + 1], sign * block[3 * p + 2]
    history.squares[window] += r_x * block[3 * p] + r_y * block[3 * p + 1] + r_z * block[3 * p + 2]
    for j in range(p):
        x, y, z = block[j], block[p + j], block[2 * p + j]
        if x != 0.0 or y != 0.0 or z != 0.0:
            pull[j] += x * r_x + y * r_y + z * r_z
            x, y, z, row = sign * x, sign * y, sign * z, gram[j]
            for q in range(j + 1):
                row[q] += x * block[q] + y * block[p + q] + z * block[2 * p + q]


@kernel
def likelihood_ratios(history, theta, precision, model, scores):
    """Fill the scores with the best window of each jump.

    Args:
      history: `BlockHistory`.
      theta: θ̂ before the window, shape (p,).
      precision: P⁻¹, shape (p, p).
      model: `ParameterModel`, whose smallest and largest jumps bound d̂.
      scores: `JumpScores`, filled in place.

    Returns:
      Σ of squares of ρ − X θ̂ over each window per its 3 m numbers, shape (windows,); 0 for windows that the
      history does not fill.
    """
    p, windows, count, gram = theta.size, len(_LENGTHS), scores.size.size, history.gram
    left = _Residuals(np.empty((windows, p)), np.zeros(windows))
    clear_scores(scores)
    _residuals(history, theta, left)
    whole, solved = precision.copy(), np.empty(p)
    for j in range(p):
        for q in range(j + 1):
            whole[j, q] += gram[_WHOLE, j, q]
            whole[q, j] = whole[j, q]
    chol = np.linalg.cholesky(whole)
    solve_lower(chol, left.pull[_WHOLE], solved)
    whitened = _whiten_columns(gram, chol, windows, count)
    shape = windows, count
    jumps = _Jumps(np.zeros(shape), np.empty(shape), np.empty(shape))
    for w in range(windows):
        if history.cursor[FILLED] >= _LENGTHS[w]:
            columns = whitened[:, w * count : (w + 1) * count]
            _estimate_jumps(gram[w], left.pull[w], solved, columns, model, w, jumps)
        else:
            left.squares[w] = 0.0
    for h in range(count):
        _choose_window(gram, left, chol, solved, whitened, jumps, h, scores)
    return left.squares / (3.0 * _LENGTHS)


@kernel
def _residuals(history, theta, left):
    """Fill `_Residuals`: Xᵀ r = Xᵀ ρ − XᵀX θ̂ and rᵀ r = ρᵀ ρ − θ̂ᵀ (Xᵀ ρ + Xᵀ r)."""
    for w in range(left.squares.size):
        gram, pull, pulled = history.gram[w], history.pull[w], left.pull[w]
        pulled[:] = pull
        for j in range(theta.size):
            row, value, total = gram[j], theta[j], gram[j, j] * theta[j]
            for q in range(j):
                total += row[q] * theta[q]
                pulled[q] -= row[q] * value
            pulled[j] -= total
        squares = history.squares[w]
        for j in range(theta.size):
            squares -= theta[j] * (pull[j] + pulled[j])
        left.squares[w] = max(squares, 0.0)


@kernel
def _whiten_columns(gram, chol, windows, count):
    """L⁻¹ Xᵀ x_h of the first columns x_h over every window, shape (p, windows × columns), windows in turn.

    All of them together, since each loop over one window's is too short for the processor's vectors.

    Args:
      gram: XᵀX below the diagonal of each window, shape (windows or more, p, p).
      chol: L, shape (p, p).
      windows: Number of windows.
      count: Number of columns.
    """
    p = chol.shape[0]
    out = np.empty((p, windows * count))
    for j in range(p):
        row = out[j]
        for w in range(windows):
            for h in range(count):
                row[w * count + h] = gram[w, h, j] if j <= h else gram[w, j, h]
        for q in range(j):
            above, factor = out[q], chol[j, q]
            for k in range(row.size):
                row[k] -= factor * above[k]
        for k in range(row.size):
            row[k] /= chol[j, j]
    return out


@kernel
def _estimate_jumps(gram, pulled, solved, whitened, model, window, jumps):
    """Estimate every hypothesis at one window.

    Args:
      gram: XᵀX of the window below its diagonal, shape (p, p).
      pulled: Xᵀ r of the window, shape (p,).
      solved: L⁻¹ Xᵀ r of the whole second, shape (p,).
      whitened: From `_whiten_columns` for this window, shape (p, 2n+2).
      model: `ParameterModel`.
      window: Index of the window.
      jumps: `_Jumps`, whose row of this window is filled.
    """
    count = whitened.shape[1]
    score, column = pulled[:count].copy(), np.empty(count)
    for h in range(count):
        column[h] = gram[h, h]
    for j in range(solved.size):  # by rows, which are contiguous
        row, factor = whitened[j], solved[j]
        for h in range(count):
            score[h] -= row[h] * factor
            column[h] -= row[h] * row[h]
    for h in range(count):
        if column[h] > 1e-6:
            size = min(max(score[h] / column[h], model.smallest[h]), model.largest[h])
            jumps.likelihood[window, h] = 0.5 * size * (2.0 * score[h] - size * column[h])
            jumps.size[window, h], jumps.information[window, h] = size, column[h]


@kernel
def _choose_window(gram, left, chol, solved, whitened, jumps, h, scores):
    """Fill the scores of one hypothesis with its best window.

    Dividing by the misfit only lowers Λ, so that windows come in the order of Λ before it, and few need it.

    Args:
      gram: XᵀX below the diagonal of each window, shape (windows or more, p, p).
      left: `_Residuals`.
      chol: Factor L of P⁻¹ + XᵀX of the whole second, shape (p, p).
      solved: L⁻¹ Xᵀ r of the whole second, shape (p,).
      whitened: From `_whiten_columns`, shape (p, windows × (2n+2)).
      jumps: `_Jumps`; Λ of the windows that were considered are set to 0.
      h: Index of the hypothesis.
      scores: `JumpScores`, changed in place.
    """
    likelihoods, shift = jumps.likelihood[:, h], np.empty(solved.size)
    while True:
        w = 0
        for k in range(1, likelihoods.size):
            if likelihoods[k] > likelihoods[w]:
                w = k
        likelihood = likelihoods[w]
        if likelihood <= scores.likelihood[h]:
            return
        likelihoods[w] = 0.0
        size, length = jumps.size[w, h], float(_LENGTHS[w])
        column = whitened[:, w * scores.size.size + h]
        for j in range(shift.size):
            shift[j] = solved[j] - size * column[j]
        solve_lower_transposed(chol, shift)
        squares = _misfit(gram[w], left.pull[w], left.squares[w], shift, h, size)
        likelihood /= max(1.0, squares / (3.0 * length))
        if likelihood > scores.likelihood[h]:
            scores.likelihood[h], scores.size[h] = likelihood, size
            scores.deviation[h], scores.window[h] = jumps.information[w, h] ** -0.5, length


@kernel
def _misfit(gram, pulled, squares, shift, h, size):
    """Squares that a jump and the parameters that follow it leave in a window.

    Args:
      gram: XᵀX of the window below its diagonal, shape (p, p).
      pulled: Xᵀ r of the window, shape (p,).
      squares: rᵀ r of the window.
      shift: Change s of θ, shape (p,).
      h: Index of the hypothesis.
      size: Jump d̂.
    """
    p, beside = shift.size, np.empty(shift.size)
    left, across = squares - size * (2.0 * pulled[h] - size * gram[h, h]), gram[h]
    for j in range(p):  # 2 (Xᵀ (x_h d̂ − r) + ½ Xᵀ X s), summed by rows
        row, value = gram[j], shift[j]
        beside[j] = 2.0 * (size * (across[j] if j <= h else row[h]) - pulled[j]) + row[j] * value
        for q in range(j):
            beside[q] += 2.0 * row[q] * value
    for j in range(p):
        left += shift[j] * beside[j]
    return left


@kernel
def solve_lower_transposed(chol, right):
    """Solve Lᵀ y = b by substitution, in place.

    Args:
      chol: L, shape (p, p).
      right: b, replaced by y, shape (p,).
    """
    for j in range(right.size - 1, -1, -1):
        right[j] /= chol[j, j]
        row, value = chol[j], right[j]
        for q in range(j):
            right[q] -= row[q] * value


@kernel
def solve_lower(chol, right, out):
    """Solve L y = b by substitution.

    Args:
      chol: L, shape (p, p).
      right: b, shape (p,).
      out: Output y, shape (p,); may be `right`.
    """
    for j in range(right.size):
        value = right[j]
        for q in range(j):
            value -= chol[j, q] * out[q]
        out[j] = value / chol[j, j]


@kernel
def inverted(matrix):
    """Inverse of a symmetric positive definite matrix A = L Lᵀ as L⁻ᵀ L⁻¹, in half the time of one by pivots.

    Args:
      matrix: A, shape (p, p).
    """
    p, chol = matrix.shape[0], np.linalg.cholesky(matrix)
    root, inverse = np.zeros((p, p)), np.zeros((p, p))  # L⁻¹ and A⁻¹
    for j in range(p):
        row = root[j]
        row[j] = 1.0
        for q in range(j):
            above, factor = root[q], chol[j, q]
            for k in range(q + 1):
                row[k] -= factor * above[k]
        for k in range(j + 1):
            row[k] /= chol[j, j]
    for j in range(p):
        row = root[j]
        for q in range(j + 1):
            out, factor = inverse[q], row[q]
            for k in range(q + 1):
                out[k] += factor * row[k]
    for j in range(p):
        for q in range(j):
            inverse[q, j] = inverse[j, q]
    return inverse
