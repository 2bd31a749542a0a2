static void restarted(loop_state *s)
{
    memcpy(s->x, FIRST_MEAN, sizeof s->x);
    memcpy(s->P, FIRST_COVARIANCE, sizeof s->P);
    s->repairs = 0;
}

NAME_outcome NAME_input(loop_state *s, const real *u)
{
    if (!are_finite(u, M))
        return PREFIX_NOT_FINITE;
    for (int j = 0; j < M; j++)
        s->input[j] = u[j];
#ifdef LAW
    taken_over(s);
#endif
    return PREFIX_FUSED;
}

#ifdef PERIOD
/* The number of the step of the model that is nearest to a time. */
static double nearest(int64_t time)
{
    return rint((double)time / PERIOD_NS);
}
#endif

NAME_outcome NAME_predict(loop_state *s, real dt)
{
    real x[N], P[N * N], U[N * N];
    if (!(dt >= 0 && dt < R(1e9)))
        return PREFIX_BAD_TIME;
    if (dt == 0)
        return PREFIX_FUSED;
    int64_t passed = (int64_t)llround(dt * R(1e9));
    if (s->time > INT64_MAX / 4) { /* after 73 years: what was then says nothing now */
        s->time = 0;
        memset(s->records, 0, sizeof s->records);
    }
    s->time += passed;
#ifdef PERIOD
    const double steps = nearest(s->time) - nearest(s->time - passed);
    if (steps <= 0)
        return PREFIX_FUSED;
    dt = (real)steps * PERIOD;
    passed = (int64_t)(steps * PERIOD_NS + 0.5); /* in double precision, whatever real is */
#endif
    memcpy(x, s->x, sizeof x);
    memcpy(P, s->P, sizeof P);
    if ((MAX_GAP > 0 && passed > MAX_GAP) || !predicted(s, dt, x, P) || !are_finite(x, N) ||
        !repaired(P, U, &s->repairs)) {
        restarted(s);
        s->restarts += 1;
        return PREFIX_RESTARTED;
    }
    memcpy(s->x, x, sizeof x);
    memcpy(s->P, P, sizeof P);
    return PREFIX_FUSED;
}

/* Whether R, of k rows, is finite, symmetric and positive definite. */
static int is_covariance(const real *R_y, int k)
{
    real U[K_MOST * K_MOST];
    for (int i = 0; i < k; i++)
        for (int j = 0; j < i; j++)
            if (!(fabs(R_y[i * k + j] - R_y[j * k + i]) <=
                  R(1e-8) + R(1e-5) * fabs(R_y[j * k + i])))
                return 0;
    return are_finite(R_y, k * k) && factored(R_y, k, 0, U);
}

static NAME_outcome correct(loop_state *s, int index, const real *y, const real *R_y)
{
    const sensor *of = SENSOR + index;
    correction c;
    real U[N * N];
    uint32_t repairs = s->repairs;
    NAME_outcome found = PREFIX_FUSED;
    if (!are_finite(y, size_of(of)))
        return PREFIX_NOT_FINITE;
    if (R_y && !is_covariance(R_y, size_of(of)))
        return PREFIX_BAD_COVARIANCE;
    if (s->records[index].seen && s->records[index].time == s->time)
        return PREFIX_DUPLICATE;
    if (!R_y)
        R_y = of->covariance;
    if (!corrected(s->x, s->P, of, y, R_y, &c))
        found = PREFIX_INDEFINITE;
    else if (of->gate > 0 && !(c.nis <= of->gate))
        found = rejected(s, index, y, R_y, &c);
    else
        recorded(s->records + index, s->time, 1);
    if (found == PREFIX_FUSED || found == PREFIX_RECOVERED) {
        if (are_finite(c.x, N) && repaired(c.P, U, &repairs)) {
            memcpy(s->x, c.x, sizeof c.x);
            memcpy(s->P, c.P, sizeof c.P);
            s->repairs = repairs;
        } else
            found = PREFIX_INDEFINITE;
    }
    if (found == PREFIX_INDEFINITE)
        recorded(s->records + index, s->time, -1);
    else {
        memcpy(s->innovation, c.innovation, (size_t)of->size * sizeof(real));
        memcpy(s->S, c.S, (size_t)(of->size * of->size) * sizeof(real));
        s->nis = c.nis;
    }
    return found;
}

void NAME_init(loop_state *s)
{
    memset(s, 0, sizeof *s);
    restarted(s);
    memcpy(s->input, IDLE, sizeof s->input);
#ifdef LAW
    begin(s);
#endif
}
