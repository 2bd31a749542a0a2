/* x' = F x + G u, with the matrices of the last length of a step kept in the struct. */

static int sampled(loop_state *s, real dt)
{
    if (s->dt == dt)
        return DONE;
    s->dt = dt;
    if (sample(dt, s->F, s->G, s->Q) == DONE)
        return DONE;
    s->dt = 0;
    return OVERFLOW_WITHIN;
}

static int moved_by(loop_state *s, const real *x, const real *u, real dt, real *moved)
{
    if (sampled(s, dt) != DONE)
        return OVERFLOW_WITHIN;
    real sum[N];
    for (int i = 0; i < N; i++) {
        sum[i] = 0;
        for (int j = 0; j < N; j++)
            sum[i] += s->F[i * N + j] * x[j];
        for (int j = 0; j < M; j++)
            sum[i] += s->G[i * M + j] * u[j];
    }
    wrap(sum, moved);
    return DONE;
}

static int linearized(loop_state *s, const real *x, const real *u, real dt, real *moved, real *F,
                      real *Q)
{
    if (moved_by(s, x, u, dt, moved) != DONE)
        return OVERFLOW_WITHIN;
    memcpy(F, s->F, sizeof s->F);
    memcpy(Q, s->Q, sizeof s->Q);
    return DONE;
}

static int parts(real dt)
{
    (void)dt;
    return 1;
}
