/* SPDX-License-Identifier: Apache-2.0
 *
 * An extended Kalman filter that processes readings in the order of their times, with the matrices
 * of each step. What stands before this text is beliefs.c, and what that needs.
 */

typedef void sense(const double *x, const double *p, double *y, double *H);
typedef void move(double *v);

/* y and R of one reading stand behind those of another, and so do the results */
struct sensor {
    sense *sensed;       /* 0 for y = H x + c, the numbers of which are H and c */
    const double *p;
    move *subtract;      /* 0 without rotations */
    const double *turns; /* of each coordinate, a whole turn; 0 if it is no angle */
    double limit;        /* the largest normalised square of an innovation that is fused */
    long k;
    const double *y, *R;
    double *H, *K, *S, *innovation, *white, *log, *whitened;
    double *square;      /* normalised, of each innovation that is fused; 0 if not wanted */
};

struct sequence {
    long length;
    const double *dt;     /* of the step to each instant */
    const long *parts;    /* into which it is divided */
    const long *input;    /* that acts in it, one of inputs */
    const double *inputs;
    const long *sensor;   /* that is read then; -1 for none */
    struct sensor *sensors;
    const double *p;
    double max_step;
    long kept;            /* 0 if of each reading only S, innovation and whether it is fused are */
    move *arrive;         /* 0 without rotations */
    double *x, *P;        /* the belief, at the end that after the last instant */
    double *F, *Q, *predicted, *covariance; /* of each reading that is fused */
    char *fused;
    /* the beliefs after all instants of a pass that ends before a reading beyond its limit; 0 for
     * one that leaves such readings out */
    double *means, *covariances;
    const long *start, *row; /* of such a pass: the instant behind which a step begins, -1 for none,
                              * and the reading */
};

static int is_finite(const double *x, long count)
{
    for (long i = 0; i < count; i++)
        if (!isfinite(x[i]))
            return 0;
    return 1;
}

/* The step to an instant, behind the step F, Q from the reading before unless it is the first; 0
 * where it fails. */
INLINE int predicted(const struct sequence *s, long at, int first, double *F, double *Q)
{
    const double *u = s->inputs + s->input[at] * M;
    double moved[N], F_k[N * N], Q_k[N * N], half[N * N], h = s->dt[at] / (double)s->parts[at];
    for (long part = 0; part < s->parts[at]; part++) {
        if (linearize(s->x, u, h, s->max_step, s->p, moved, F_k, Q_k))
            return 0;
        memcpy(s->x, moved, sizeof moved);
        sandwiched(F_k, s->P, Q_k, half);
        memcpy(s->P, half, sizeof half);
        if (!s->kept)
            continue;
        if (first && part == 0) {
            memcpy(F, F_k, sizeof F_k);
            memcpy(Q, Q_k, sizeof Q_k);
            continue;
        }
        sandwiched(F_k, Q, Q_k, half);
        memcpy(Q, half, sizeof half);
        dense_product(F_k, F, half);
        memcpy(F, half, sizeof half);
    }
    return 1;
}

/* What a sensor reads at x, and H. */
INLINE void sense_at(const struct sensor *of, const double *x, double *y, double *H)
{
    if (of->sensed) {
        of->sensed(x, of->p, y, H);
        return;
    }
    memcpy(H, of->p, of->k * N * sizeof *H);
    for (long r = 0; r < of->k; r++) {
        y[r] = of->p[of->k * N + r];
        for (int j = 0; j < N; j++)
            y[r] += H[r * N + j] * x[j];
    }
}

INLINE void difference(const struct sensor *of, const double *y, const double *expected, double *e)
{
    double v[3 * MOST_READ];
    const long k = of->k;
    for (long i = 0; i < k; i++) {
        v[i] = y[i], v[k + i] = expected[i];
        v[2 * k + i] = y[i] - expected[i];
    }
    if (of->subtract)
        of->subtract(v);
    for (long i = 0; i < k; i++) {
        const double turn = of->turns[i];
        double d = v[2 * k + i];
        if (turn > 0 && !of->subtract) {
            d = fmod(d + turn / 2, turn);
            d = (d < 0 ? d + turn : d) - turn / 2;
        }
        e[i] = d;
    }
}

/* `corrections` of one belief, the factor L of S, and L^-1 e with its square; 0 where it fails. */
INLINE int weighed(double *v, long k, double *L, double *whitened, double *square)
{
    const double *e = v + N + N * N + k * N + k * k, *mean = e + k, *S = mean + N + N * N + N * k;
    corrections(v, 1, k);
    memcpy(L, S, k * k * sizeof *L);
    if (!factored(L, k) || !is_finite(mean, N + N * N))
        return 0;
    *square = 0;
    for (long c = 0; c < k; c++) {
        whitened[c] = e[c];
        for (long l = 0; l < c; l++)
            whitened[c] -= L[c * k + l] * whitened[l];
        whitened[c] /= L[c * k + c];
        *square += whitened[c] * whitened[c];
    }
    return 1;
}

/* The mean and covariance of an error become those of a belief about x. */
INLINE void arrived(move *arrive, const double *x, const double *mean, const double *covariance,
                    double *new_x, double *new_P)
{
    double v[3 * N + 2 * N * N], *total = v + 2 * N + N * N;
    memcpy(v, mean, N * sizeof *v);
    memcpy(v + N, x, N * sizeof *v);
    memcpy(v + 2 * N, covariance, N * N * sizeof *v);
    if (arrive)
        arrive(v);
    else
        wrap(mean, total);
    memcpy(new_x, total, N * sizeof *v);
    memcpy(new_P, arrive ? total + N : v + 2 * N, N * N * sizeof *v);
}

/* v holds x, P, H, R and the innovation of one reading of k numbers, or where p is given the
 * reading itself, and receives the new x and P, K, S and the square of the whitened innovation
 * behind them; 1 where that fails, and 2 where the belief is not definite.
 */
FAST int correction(double *v, long k, sense *sensed, const double *p, move *subtract,
                    const double *turns, move *arrive)
{
    const struct sensor of = {.sensed = sensed, .p = p, .subtract = subtract, .turns = turns, .k = k};
    double *H = v + N + N * N, *e = H + k * N + k * k, *mean = e + k, *P = mean + N;
    double L[MOST_READ * MOST_READ], numbers[MOST_READ], expected[MOST_READ];
    if (p) {
        memcpy(numbers, e, k * sizeof *e);
        sense_at(&of, v, expected, H);
        difference(&of, numbers, expected, e);
    }
    if (!weighed(v, k, L, numbers, P + N * N + N * k + k * k))
        return 1;
    arrived(arrive, v, mean, P, mean, P);
    return definite(mean, P) ? 0 : 2;
}

/* The correction by the next reading of a sensor: 1 if it is fused, 0 if not, -1 where it fails. */
INLINE int fused(const struct sequence *s, struct sensor *of)
{
    const long k = of->k, behind = N + N * N + k * N + k * k + k;
    double v[2 * (N + N * N + MOST_READ * N + MOST_READ * MOST_READ) + MOST_READ + 1];
    double *P = v + N, *H = P + N * N, *R = H + k * N, *e = R + k * k, expected[MOST_READ];
    double *mean = v + behind, *after = mean + N, *K = after + N * N, *S = K + N * k;
    double L[MOST_READ * MOST_READ], square, log_size = 0;
    memcpy(v, s->x, N * sizeof *v);
    memcpy(P, s->P, N * N * sizeof *P);
    memcpy(R, of->R, k * k * sizeof *R);
    sense_at(of, s->x, expected, H);
    difference(of, of->y, expected, e);
    of->y += k, of->R += k * k;
    if (!weighed(v, k, L, of->whitened, &square))
        return -1;
    for (long c = 0; c < k && s->kept; c++) {
        log_size += 2 * log(L[c * k + c]);
        for (long r = 0; r < k; r++) { /* column c of the inverse */
            double sum = r == c;
            for (long l = c; l < r; l++)
                sum -= L[r * k + l] * of->white[l * k + c];
            of->white[r * k + c] = r < c ? 0 : sum / L[r * k + r];
        }
    }
    if (square > of->limit)
        return 0;
    memcpy(of->S, S, k * k * sizeof *S), of->S += k * k;
    memcpy(of->innovation, e, k * sizeof *e), of->innovation += k;
    if (of->square)
        *of->square++ = square;
    if (s->kept) {
        memcpy(of->H, H, k * N * sizeof *H), of->H += k * N;
        memcpy(of->K, K, k * N * sizeof *K), of->K += k * N;
        of->white += k * k, of->whitened += k;
        *of->log++ = log_size + (double)k * log(2 * acos(-1.0));
    }
    arrived(s->arrive, v, mean, after, s->x, s->P);
    return 1;
}

/* Keeps the belief after an instant, where that is wanted; 0 if it is not definite. */
INLINE int committed(const struct sequence *s, long at)
{
    if (!s->means)
        return 1;
    memcpy(s->means + at * N, s->x, N * sizeof *s->x);
    memcpy(s->covariances + at * N * N, s->P, N * N * sizeof *s->P);
    return definite(s->x, s->P);
}

/* Returns the number of instants that were processed. */
FAST long pass(const struct sequence *s)
{
    double *F = s->F, *Q = s->Q, *x = s->predicted, *P = s->covariance;
    double first_x[N], first_P[N * N];
    memcpy(first_x, s->x, sizeof first_x);
    memcpy(first_P, s->P, sizeof first_P);
    for (long at = 0, steps = 0; at < s->length; at++) {
        if (s->means) {
            const long start = s->start[at];
            memcpy(s->x, start < 0 ? first_x : s->means + start * N, sizeof first_x);
            memcpy(s->P, start < 0 ? first_P : s->covariances + start * N * N, sizeof first_P);
        }
        if (s->dt[at] > 0 && !predicted(s, at, !steps++, F, Q))
            return at;
        if (!committed(s, at))
            return at;
        if (s->sensor[at] < 0)
            continue;
        if (!is_finite(s->x, N))
            return at;
        if (!steps++) {
            memset(F, 0, N * N * sizeof *F);
            memset(Q, 0, N * N * sizeof *Q);
            for (int i = 0; i < N; i++)
                F[i * N + i] = 1;
        }
        memcpy(x, s->x, N * sizeof *x);
        memcpy(P, s->P, N * N * sizeof *P);
        struct sensor *of = s->sensors + s->sensor[at];
        const struct sensor before = *of;
        if (s->means)
            of->y += s->row[at] * of->k, of->R += s->row[at] * of->k * of->k;
        const int outcome = fused(s, of);
        if (s->means)
            of->y = before.y, of->R = before.R;
        if (outcome < 0 || (s->means && (!outcome || !committed(s, at))))
            return at;
        if (outcome) {
            s->fused[at] = 1;
            steps = 0;
            if (s->kept)
                F += N * N, Q += N * N, x += N, P += N * N;
        }
    }
    return s->length;
}
