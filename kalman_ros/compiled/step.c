/* SPDX-License-Identifier: Apache-2.0
 *
 * One step of a model, and its linearisation: `core.Model.step` for one state, with the same
 * operations in the same order.
 *
 * What stands before this text is flow.c, and generated from the model: N states, M inputs and
 * MOST_SUBSTEPS; the functions derivative, substep and wrap; with SLOPE also the function slope and
 * F_ROW, F_COLUMN, F_COUNT of the F of a substep, whose product is that of the step. p are the
 * numbers of the model.
 */

/* F, where it is wanted, receives the derivative of the step */
static void advance(const real *x, const real *u, real dt, real max_step,
                    const real *p, real *moved, real *F)
{
    real last[N], next[N];
    real count = fmax((real)1, ceil(fmin(fabs(dt) / max_step, (real)MOST_SUBSTEPS)));
    real h = dt / count;
#ifndef SLOPE
    (void)F;
#endif
    memcpy(last, x, sizeof last);
    for (real k = 0; k < count; k += 1) {
#ifdef SLOPE
        if (F) {
            real f[F_COUNT + 1], before[N * N];
            slope(last, u, &h, p, f);
            memcpy(before, F, sizeof before);
            product(F_COUNT, F_ROW, F_COLUMN, f, 1, before, F);
        }
#endif
        substep(last, u, &h, p, next);
        memcpy(last, next, sizeof last);
    }
    wrap(last, moved);
}

#ifdef SLOPE
#define F_BY_FLOW 0
#else
#define F_BY_FLOW 1
#endif

/* The step, and its F unless that is of the flow. */
static void step_once(const real *x, const real *u, real dt, real max_step, const real *p,
                      real *moved, real *F)
{
    for (int i = 0; i < N * N && !F_BY_FLOW; i++)
        F[i] = i % (N + 1) == 0;
    advance(x, u, dt, max_step, p, moved, F_BY_FLOW ? 0 : F);
}

static int linearize(const real *x, const real *u, real dt, real max_step,
                     const real *p, real *moved, real *F, real *Q)
{
    const int outcome = flow(x, u, dt, p, F, Q, F_BY_FLOW);
    step_once(x, u, dt, max_step, p, moved, F);
    return outcome;
}
