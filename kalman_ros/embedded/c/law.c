/* u = u_e - K (x - x_e) - K_q q, within what the actuators can do. */

static void begin(loop_state *s)
{
    memcpy(s->state, REST_STATE, sizeof s->state);
    memcpy(s->held, REST_INPUT, sizeof s->held);
    memcpy(s->output, IDLE, sizeof s->output);
#ifdef MOTION
    s->row = -1;
#endif
}

/* The gain of now. */
static const real *gain(const loop_state *s)
{
#ifdef MOTION_GAINS
    if (s->row >= 0)
        return MOTION_GAIN + s->row * M * N_MODEL;
#endif
    (void)s;
    return GAIN;
}

/* The input of the law for a state, and the state's error. */
static void by_gain(const loop_state *s, const real *x, real *error, real *u)
{
    model_difference(x, s->state, error);
    for (int j = 0; j < M; j++) {
        real sum = 0;
        for (int i = 0; i < N_MODEL; i++)
            sum += gain(s)[j * N_MODEL + i] * error[i];
        u[j] = s->held[j] - sum;
#ifdef TRACKED
        sum = 0;
        for (int i = 0; i < TRACKED; i++)
            sum += INTEGRAL_GAIN[j * TRACKED + i] * s->integral[i];
        u[j] -= sum;
#endif
    }
}

#ifdef BLEND
/* Let the input go on from its last value. */
static void go_on(loop_state *s, const real *x)
{
    real error[N_MODEL], u[M];
    by_gain(s, x, error, u);
    for (int j = 0; j < M; j++)
        s->jump[j] = s->output[j] - u[j];
}
#endif

#ifdef MOTION
/* What the motion is at now: between two steps, the state is on the straight line between theirs. */
static void aim(loop_state *s)
{
    const double passed = s->elapsed / MOTION_STEP;
    const double reached = passed < LAST_STEP ? passed : LAST_STEP;
    const int step = (int)(reached + AT_A_STEP);
    const double share = reached - step;
    const real *at = MOTION_STATE + step * N_MODEL;
    memcpy(s->state, at, sizeof s->state);
    memcpy(s->held, MOTION_INPUT + step * M, sizeof s->held);
    if (share > AT_A_STEP) {
        real change[N_MODEL];
        model_difference(at + N_MODEL, at, change);
        for (int i = 0; i < N_MODEL; i++)
            change[i] *= (real)share;
        model_sum(at, change, s->state);
    }
#ifdef MOTION_GAINS
    s->row = step;
#endif
}

void NAME_follow(loop_state *s)
{
    s->elapsed = 0;
    s->following = 1;
    aim(s);
#ifdef BLEND
    if (s->begun)
        go_on(s, s->last);
#endif
}
#endif

/* The output acts. */
static void act(loop_state *s, real *u)
{
    for (int j = 0; j < M; j++)
        u[j] = s->input[j] = s->output[j];
}

/* The input that acts is from elsewhere: the law goes on from it. */
static void taken_over(loop_state *s)
{
    for (int j = 0; j < M; j++)
        s->output[j] = fmin(fmax(s->input[j], LOWER[j]), UPPER[j]);
    s->released = 1;
}

/* Move the output towards a wanted one. */
static void toward(loop_state *s, const real *wanted, real seconds)
{
    for (int j = 0; j < M; j++) {
        real u = wanted[j], reach = RATE[j] < INFINITY ? RATE[j] * seconds : RATE[j];
        u = fmin(fmax(u, LOWER[j]), UPPER[j]);
        s->output[j] = fmin(fmax(u, s->output[j] - reach), s->output[j] + reach);
    }
}

NAME_outcome NAME_hold(loop_state *s, const real *reference)
{
    real r[N_MODEL], x[N_MODEL], u[M], largest = 0;
    if (!are_finite(reference, N_MODEL))
        return PREFIX_NOT_FINITE;
    model_difference(reference, REST_STATE, r);
    for (int i = 0; i < N_MODEL; i++) {
        x[i] = 0;
        for (int j = 0; j < N_MODEL; j++)
            x[i] += STATE_GAIN[i * N_MODEL + j] * r[j];
        largest = fmax(largest, fabs(r[i]));
    }
    for (int i = 0; i < N_MODEL; i++)
        if (!(fabs(x[i] - r[i]) <= REACHED * largest))
            return PREFIX_UNREACHABLE;
    for (int i = 0; i < M; i++) {
        u[i] = REST_INPUT[i];
        for (int j = 0; j < N_MODEL; j++)
            u[i] += INPUT_GAIN[i * N_MODEL + j] * r[j];
    }
    if (!are_finite(u, M))
        return PREFIX_NOT_FINITE;
    for (int j = 0; j < M; j++) {
        const real nearest = fmin(fmax(u[j], LOWER[j]), UPPER[j]);
        if (!(fabs(u[j] - nearest) <= BEYOND * fabs(nearest)))
            return PREFIX_UNREACHABLE;
    }
    for (int i = 0; i < N_MODEL; i++)
        s->state[i] = REST_STATE[i] + x[i];
    memcpy(s->held, u, sizeof u);
#ifdef MOTION
    const int moving = s->following;
    s->following = 0;
    s->row = -1;
#ifdef BLEND
    if (moving && s->begun)
        go_on(s, s->last);
#else
    (void)moving;
#endif
#endif
    return PREFIX_FUSED;
}

NAME_outcome NAME_control(loop_state *s, real dt, real *u)
{
    real error[N_MODEL], wanted[M];
    if (!(dt >= 0 && dt < LONGEST)) {
        memcpy(u, s->output, sizeof s->output);
        return PREFIX_BAD_TIME;
    }
    const real passed = s->begun ? fmin(dt, LONGEST_PASSED) : 0;
    if (s->released) { /* from the idle input on */
#ifdef TRACKED
        memset(s->integral, 0, sizeof s->integral);
#endif
#ifdef BLEND
        go_on(s, s->x);
#endif
        s->released = 0;
    }
#ifdef MOTION
    if (s->following) {
        s->elapsed += s->following > 1 ? (double)passed : 0;
        s->following = s->elapsed < DURATION ? 2 : 0;
        aim(s);
    }
#endif
    by_gain(s, s->x, error, wanted);
#ifdef BLEND
    const real left = exp(-passed / BLEND);
    for (int j = 0; j < M; j++)
        wanted[j] += s->jump[j] *= left;
#endif
    if (!are_finite(wanted, M)) {
        NAME_idle(s, dt, u);
        return PREFIX_NOT_FINITE;
    }
    toward(s, wanted, dt > 0 ? dt : R(STEP));
#ifdef TRACKED
    int saturated = 0;
    for (int j = 0; j < M; j++) {
        real more = 0;
        for (int i = 0; i < TRACKED; i++)
            more -= INTEGRAL_GAIN[j * TRACKED + i] * error[PLACES[i]];
        saturated |= more * (wanted[j] - s->output[j]) > 0;
    }
    for (int i = 0; i < TRACKED && !saturated; i++)
        s->integral[i] += error[PLACES[i]] * passed;
#endif
#ifdef BLEND
    memcpy(s->last, s->x, sizeof s->last);
#endif
    (void)passed;
    s->begun = 1;
    act(s, u);
    return PREFIX_FUSED;
}

void NAME_idle(loop_state *s, real dt, real *u)
{
    toward(s, IDLE, dt > 0 && dt < LONGEST ? dt : 0);
    act(s, u);
    s->released = 1;
}
