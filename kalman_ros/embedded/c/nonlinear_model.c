/* A step of the integrator, linearised about its start. */

static int linearized(loop_state *s, const real *x, const real *u, real dt, real *moved, real *F,
                      real *Q)
{
    (void)s;
    return linearize(x, u, dt, MAX_STEP, NUMBERS, moved, F, Q);
}

/* The number of equal parts in which a covariance is predicted. */
static int parts(real dt)
{
    real share = dt / MAX_STEP, one = 1 + R(1e-9);
    if (!(one < share && share <= MOST_SUBSTEPS))
        return 1;
    return (int)ceil(fmin(share / one, R(100)));
}
