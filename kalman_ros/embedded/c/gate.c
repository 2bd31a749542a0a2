/* The gate: it accepts or rejects a reading, and recovers from a wrong estimate. A state is vouched
 * for by sensors that agree; the others are widened after too many rejections.
 */

#define SILENCE 1000000000
#define INTERVALS 10
#define MOST_WIDENINGS 20

static void recorded(NAME_record *of, int64_t now, int agrees)
{
    if (of->seen && now != of->time)
        of->interval = now - of->time;
    of->rejections = agrees == 0 ? of->rejections + 1 : 0;
    of->time = now;
    of->agrees = (int8_t)agrees;
    of->seen = 1;
}

/* Whether another reading is expected of a sensor. */
static int alive(const NAME_record *of, int64_t now)
{
    const int64_t silence = now - of->time;
    if (!of->seen || (MAX_GAP > 0 && silence > MAX_GAP))
        return 0;
    return !of->interval || silence <= SILENCE ||
           (silence + INTERVALS - 1) / INTERVALS <= of->interval;
}

/* Which states each sensor sees: a slope may vanish at one point, so two are tried. */
static void seen_states(const real *x, const real *P, signed char seen[SENSORS][N])
{
    real points[2][N], H[K_MOST * N];
    memset(seen, 0, SENSORS * sizeof *seen);
    for (int i = 0; i < N; i++) {
        points[0][i] = x[i];
        points[1][i] = x[i] + sqrt(P[i * N + i]);
    }
    for (int of = 0; of < SENSORS; of++)
        for (int p = 0; p < 2; p++) {
            SENSOR[of].jacobian(points[p], H);
            for (int i = 0; i < SENSOR[of].size; i++)
                for (int j = 0; j < N; j++)
                    if (H[i * N + j] != 0)
                        seen[of][j] = 1;
        }
}

/* Widen what no other sensor vouches for until the reading passes; 0 if it never does. */
static int widened(const loop_state *s, const sensor *of, const real *y, const real *R_y,
                   const signed char *vouched, correction *c)
{
    real P[N * N];
    memcpy(P, s->P, sizeof P);
    for (int k = 0; k < MOST_WIDENINGS; k++) {
        for (int i = 0; i < N; i++)
            for (int j = 0; j < N; j++)
                P[i * N + j] *= R(vouched[i] ? 1 : 2) * R(vouched[j] ? 1 : 2);
        if (!corrected(s->x, P, of, y, R_y, c))
            return -1;
        if (c->nis <= of->gate)
            return 1;
    }
    return 0;
}

static NAME_outcome rejected(loop_state *s, int index, const real *y, const real *R_y, correction *c)
{
    const uint32_t needed = RECOVER_AFTER;
    NAME_record *records = s->records;
    signed char seen[SENSORS][N], vouched[N], involved[SENSORS] = {0};
    int outvoted = 1, refused = 0, count = 0;
    uint32_t total = 0;
    if (!isfinite(c->nis))
        return PREFIX_INDEFINITE;
    recorded(records + index, s->time, 0);
    for (int of = 0; of < SENSORS; of++)
        total += records[of].rejections;
    if (!needed || total < needed)
        return PREFIX_REJECTED;
    seen_states(s->x, s->P, seen);
    for (int i = 0; i < N; i++) {
        int agreeing = 0, contradicting = 0;
        for (int of = 0; of < SENSORS; of++)
            if (seen[of][i] && alive(records + of, s->time)) {
                agreeing += records[of].agrees == 1;
                contradicting += records[of].agrees == 0;
            }
        vouched[i] = agreeing > 0 && 2 * agreeing >= contradicting;
        if (seen[index][i] && vouched[i])
            refused = records[index].rejections >= needed;
        if (seen[index][i] && !vouched[i]) {
            outvoted = 0;
            for (int of = 0; of < SENSORS; of++)
                if (seen[of][i] && alive(records + of, s->time))
                    involved[of] = 1;
        }
    }
    for (int of = 0; of < SENSORS; of++)
        count += involved[of];
    const uint32_t share = count < 2 ? needed : (needed + 1) / 2;
    total = 0;
    for (int of = 0; of < SENSORS; of++)
        if (involved[of])
            total += records[of].rejections < share ? records[of].rejections : share;
    if (outvoted || total < needed)
        return refused ? PREFIX_OUTVOTED : PREFIX_REJECTED;
    const int passed = widened(s, SENSOR + index, y, R_y, vouched, c);
    if (passed < 0)
        return PREFIX_INDEFINITE;
    if (!passed)
        return refused ? PREFIX_OUTVOTED : PREFIX_REJECTED;
    for (int of = 0; of < SENSORS; of++)
        for (int i = 0; i < N; i++)
            if (seen[of][i] && !vouched[i]) {
                records[of].agrees = -1;
                records[of].rejections = 0;
            }
    return PREFIX_RECOVERED;
}

