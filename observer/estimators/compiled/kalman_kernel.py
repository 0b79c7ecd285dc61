"""The Kalman filter's compiled loop over K steps."""

# numba compiles these functions: their types are those of the arrays they get.
# mypy: disable-error-code="no-untyped-def, misc"

from __future__ import annotations

from observer.compiled import cached_loop
from observer.estimators.compiled.judging import (
    add_prior,
    doubt_nut,
    find_usable,
    gate,
    hold_back,
    invalidate,
    judge,
    move_rows,
    reopen,
    skip,
    step_is_finite,
    write_innovations,
    write_sigmas,
    write_values,
)
from observer.estimators.compiled.kernels import (
    compare,
    covariance_with_sensors,
    joint_update,
    mirror,
    predict,
    start,
)
from observer.estimators.compiled.learning import begin, draw_near, follow, give_back, keep, tell
from observer.model.advance import move_columns, put_laws


@cached_loop
def run_kalman(p, t, u, step, state, gate_sigma, out, work):
    """Run the Kalman filter over the K steps of `u`, changing `state` and filling `out`.

    `step` (K,) is where each step's length is in the table `t`. A step whose laws or known inputs are no
    numbers cannot be computed: it leaves the state as it is and is invalid.
    """
    s = u.y_degC.shape[1]
    x, P, B, C = state.x, state.P, work.B, work.C
    nu, S, g, usable, accepted = work.nu, work.S_nu, work.g, work.usable, work.accepted
    mirror(P)
    for k in range(len(step)):
        present = find_usable(u, k, usable)
        if not step_is_finite(u, k) or (state.flags[0] == 0 and present == 0):
            skip(u, k, usable, state, out)
            continue
        move_columns(p, u, k, B, C)
        if state.flags[0] == 0:
            start(p, C, u, k, usable, x, P, nu)
            begin(p, u, k, usable, C, x, P, state.around)
            put_laws(p, u, k, B, x, work.law)
            state.flags[0] = 1
        else:
            follow(p, t, step[k], u, k, B, C, state.around, x, work)
            predict(p, t, step[k], u, k, B, x, P, work)
            doubt_nut(p, u, k, state.lost_s, P)
        out.log_likelihood[k] = 0.0
        if present > 0:
            covariance_with_sensors(C, P, s, g)
            compare(p, C, u, k, usable, g, x, nu, S)
        write_innovations(nu, S, usable, k, out)
        if present > 0:
            opened = gate(nu, S, usable, state.suspect, gate_sigma, accepted)
            if opened:
                add_prior(p, P, 1.0)
            else:
                hold_back(nu, usable, accepted, state.suspect, state.refused_s, state.opened_K)
            if reopen(p, C, u.dt_s[k], usable, accepted, nu, state.refused_s, state.opened_K, P) or opened:
                covariance_with_sensors(C, P, s, g)
                compare(p, C, u, k, usable, g, x, nu, S)
            keep(p, x, P, work.kept)
            out.log_likelihood[k] = joint_update(p.R_K2, C, accepted, g, nu, S, x, P, work)
            give_back(p, x, P, work.kept)
        draw_near(p, u.dt_s[k], x, state.around)
        out.quality[k] = judge(u, k, usable, accepted, state, out)
        move_rows(p, u, k, work.rows)
        known = write_values(p, u, k, x, work, out)
        known = write_sigmas(P, out.heat_sigma, out.field_sigma, k, work) and known
        tell(p, x, P, k, work, out)
        if not known:
            invalidate(out, k)
