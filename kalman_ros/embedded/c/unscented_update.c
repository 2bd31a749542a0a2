/* Points about x at the rows of U, a factor of its covariance, times the spread: one a row. */
static void spread(const real *x, const real *U, real points[POINTS][N])
{
    for (int i = 0; i < N; i++) {
        points[0][i] = x[i];
        for (int j = 0; j < N; j++) {
            points[1 + j][i] = x[i] + SPREAD * U[j * N + i];
            points[1 + N + j][i] = x[i] - SPREAD * U[j * N + i];
        }
    }
}

static real weight_of_mean(int p) { return p ? R(OTHERS) : R(CENTRE_OF_MEAN); }
static real weight(int p) { return p ? R(OTHERS) : R(CENTRE); }

/* The weighted mean of points of some numbers; that of an angle is a direction. */
static void mean_of(const real *points, int size, const signed char *angles, real *mean)
{
    for (int i = 0; i < size; i++) {
        real sum = 0, east = 0, north = 0;
        for (int p = 0; p < POINTS; p++) {
            sum += weight_of_mean(p) * points[p * size + i];
            if (angles[i]) {
                east += weight_of_mean(p) * cos(points[p * size + i]);
                north += weight_of_mean(p) * sin(points[p * size + i]);
            }
        }
        mean[i] = angles[i] ? atan2(north, east) : sum;
    }
}

FAST static int predicted(loop_state *s, real dt, real *x, real *P)
{
    const int count = parts(dt);
    const real h = dt / (real)count;
    real U[N * N], points[POINTS][N], F[N * N], Q[N * N], Q_k[N * N], moved[N];
    if (!repaired(P, U, &s->repairs))
        return 0;
    spread(x, U, points);
    memset(Q, 0, sizeof Q);
    for (int k = 0; k < count; k++) {
        if (linearized(s, points[0], s->input, h, moved, F, Q_k) != DONE)
            return 0;
        sandwich(F, Q_k, Q);
        for (int p = 0; p < POINTS; p++) {
            if (moved_by(s, points[p], s->input, h, moved) != DONE)
                return 0;
            memcpy(points[p], moved, sizeof moved);
        }
    }
    mean_of(points[0], N, ANGLES, x);
    for (int p = 0; p < POINTS; p++) {
        state_difference(points[p], x, moved);
        memcpy(points[p], moved, sizeof moved);
    }
    for (int i = 0; i < N; i++)
        for (int j = 0; j <= i; j++) {
            real sum = Q[i * N + j];
            for (int p = 0; p < POINTS; p++)
                sum += weight(p) * points[p][i] * points[p][j];
            P[i * N + j] = sum;
            P[j * N + i] = sum;
        }
    return 1;
}

/* K = P_xy S^-1, P = sum of W (dx - K dy) (dx - K dy)' + K R K'. 0 if there is no gain. */
FAST static int corrected(const real *x, const real *P, const sensor *of, const real *y,
                     const real *R_y, correction *c)
{
    const int k = size_of(of);
    uint32_t repairs = 0;
    real definite[N * N], U[N * N], U_S[K_MOST * K_MOST], points[POINTS][N];
    real read[POINTS * K_MOST], mean[K_MOST], K[N * K_MOST], moved[N], P_after[N * N];
    memcpy(definite, P, sizeof definite);
    if (!repaired(definite, U, &repairs))
        return 0;
    spread(x, U, points);
    for (int p = 0; p < POINTS; p++)
        of->measure(points[p], read + p * k);
    mean_of(read, k, of->angles, mean);
    of->difference(y, mean, c->innovation);
    for (int p = 0; p < POINTS; p++) {
        real d[K_MOST];
        of->difference(read + p * k, mean, d);
        memcpy(read + p * k, d, (size_t)k * sizeof *d);
        for (int i = 0; i < N; i++)
            points[p][i] -= x[i];
    }
    for (int i = 0; i < k; i++)
        for (int j = 0; j <= i; j++) {
            real sum = R_y[i * k + j];
            for (int p = 0; p < POINTS; p++)
                sum += weight(p) * read[p * k + i] * read[p * k + j];
            c->S[i * k + j] = sum;
            c->S[j * k + i] = sum;
        }
    if (!weighed(of, c, U_S))
        return 0;
    for (int i = 0; i < N; i++) {
        for (int j = 0; j < k; j++) {
            K[i * k + j] = 0;
            for (int p = 0; p < POINTS; p++)
                K[i * k + j] += weight(p) * read[p * k + j] * points[p][i];
        }
        solved(U_S, k, 1, K + i * k);
        moved[i] = x[i];
        for (int j = 0; j < k; j++)
            moved[i] += K[i * k + j] * c->innovation[j];
    }
    for (int p = 0; p < POINTS; p++)
        for (int i = 0; i < N; i++)
            for (int j = 0; j < k; j++)
                points[p][i] -= K[i * k + j] * read[p * k + j];
    for (int i = 0; i < N; i++)
        for (int j = 0; j <= i; j++) {
            real sum = 0;
            for (int a = 0; a < k; a++)
                for (int b = 0; b < k; b++)
                    sum += K[i * k + a] * R_y[a * k + b] * K[j * k + b];
            for (int p = 0; p < POINTS; p++)
                sum += weight(p) * points[p][i] * points[p][j];
            P_after[i * N + j] = sum;
            P_after[j * N + i] = sum;
        }
    arrived(moved, x, P_after, c->x, c->P);
    return 1;
}
