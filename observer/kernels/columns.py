"""The matrices of the steady step (see `cruise`): laid out in rows, for a step length, a gain and columns.

The records are those of `observer.estimators.fixed_gain_records`. Where columns move, what they change is
laid out anew; every entry is the same sum as if all of it were.
"""

from __future__ import annotations

from observer.kernels.vector import LANES, none, store_at, weigh


def lay_out(p, t, d, B, C, K, c):
    """Fill in the matrices for step length d, the input and output columns in force and a gain K (n, s)."""
    m, n_x, known, m_e = B.shape[0], B.shape[1], p.E.shape[0], len(p.source)
    first = len(c.decay) - m_e
    for a in range(n_x):
        c.decay[a] = t.decay[d, a]
        lay_out_state(t, d, C, a, c)
    for j in range(m_e):
        c.decay[first + j] = t.heat_decay[d, j]
    for q in range(known):
        for a in range(n_x):
            c.drives[m + q, a] = (t.hold[d, a] - t.ramp[d, a]) * p.E[q, a]
            c.drives[m + known + q, a] = t.ramp[d, a] * p.E[q, a]
            c.inputs[m + q, a] = c.drives[m + q, a]
            c.inputs[m + known + q, a] = c.drives[m + known + q, a]
        c.inputs[m + known + q, n_x + q] = 1.0
    for i in range(K.shape[1]):
        for a in range(n_x):
            c.push[m_e + i, a] = K[a, i]
        for j in range(m_e):
            c.push[m_e + i, first + j] = K[n_x + j, i]
    for j in range(m):
        lay_out_source(p, t, d, B, j, c)
    lay_out_readings(p, m, c)


def lay_out_moving(p, t, d, B, C, c):
    """Fill in what columns that move change."""
    for i in range(len(p.moving)):
        lay_out_source(p, t, d, B, p.moving[i], c)
        lay_out_state(t, d, C, p.modes + p.moving[i], c)
    lay_out_readings(p, B.shape[0], c)


def lay_out_state(t, d, C, a, c):
    """What the sensors that are present have of state a at a step's end, and of what it leaves of it."""
    for i in range(len(c.present)):
        read = -C[i, a] if c.present[i] else 0.0
        c.sensors[a, i] = read
        c.seen[a, i] = read * t.decay[d, a]


def lay_out_source(p, t, d, B, j, c):
    """What the law of source j, and its heat where that is a state, do to the states in a step."""
    for a in range(B.shape[1]):
        c.drives[j, a] = t.hold[d, a] * B[j, a]
        c.inputs[j, a] = c.drives[j, a]
    for i in range(len(p.source)):
        if p.source[i] == j:
            row = len(c.drives) - len(p.source) + i
            for a in range(B.shape[1]):
                c.drives[row, a] = t.couple[d, i, a] * B[j, a]
                c.push[i, a] = c.drives[row, a]


def lay_out_readings(p, m, c):
    """By how much innovations are less for every input and heat, as the sensors see what these drive; the
    last inputs, known ones at the step's end, they have in their own rows, too.
    """
    width, m_e, known = len(c.decay), len(p.source), p.F.shape[1]
    inputs = len(c.drives) - m_e
    for w in range(len(c.drives)):
        see_drive(c, w)
        for i in range(len(c.present)):
            if w >= inputs:
                c.seen[width - m_e + w - inputs, i] = c.forced[width + i]
            elif w >= m + known and c.present[i]:
                c.inputs[w, width + i] = c.forced[width + i] - p.F[i, w - m - known]
            else:
                c.inputs[w, width + i] = c.forced[width + i]


def see_drive(c, w):
    """Put what the sensors see of row w of the drives into `c.forced`, from W on."""
    width = len(c.decay) // LANES
    for q in range(c.sensors.shape[1] // LANES):
        store_at(c.forced, width + q, weigh(none(), c.sensors, q, c.drives, w, 0))


def move_reported(p, u, k, rows):
    """Put the columns of the moving sources over step k in place among the reported rows."""
    s = len(p.R_K2)
    for i in range(len(p.moving)):
        for r in range(u.moving_C.shape[2] - s):
            rows[p.modes + p.moving[i], r] = u.moving_C[k, i, s + r]
