/* S, from H P, H and R */
static void innovation_covariance(const real *HP, const real *H, const real *R_y, int k, real *S)
{
    for (int i = 0; i < k; i++)
        for (int j = 0; j <= i; j++) {
            real sum = R_y[i * k + j];
            for (int l = 0; l < N; l++)
                sum += HP[i * N + l] * H[j * N + l];
            S[i * k + j] = sum;
            S[j * k + i] = sum;
        }
}

/* to += factor * row */
INLINE void add_row(real *to, real factor, const real *row)
{
    for (int j = 0; j < N; j++)
        to[j] += factor * row[j];
}

/* x + K z, (I - K H) P (I - K H)' + K R K': the Joseph form. 0 if there is no gain. Matrices stand
 * as rows that are added: of H, H P and K', and of P A', with A = I - K H.
 */
FAST static int corrected(const real *x, const real *P, const sensor *of, const real *y,
                     const real *R_y, correction *c)
{
    const int k = size_of(of);
    real expected[K_MOST], H[K_MOST * N], HP[K_MOST * N], U[K_MOST * K_MOST], gain[K_MOST * N];
    real moved[N], PA[N * N], rest[K_MOST * N];
    of->measure(x, expected);
    of->difference(y, expected, c->innovation);
    of->jacobian(x, H);
    memset(HP, 0, sizeof HP);
    for (int i = 0; i < k; i++)
        for (int l = 0; l < N; l++)
            if (H[i * N + l] != 0)
                add_row(HP + i * N, H[i * N + l], P + l * N);
    innovation_covariance(HP, H, R_y, k, c->S);
    const int definite = weighed(of, c, U);
    if (of->gain)
        for (int i = 0; i < k; i++)
            for (int j = 0; j < N; j++)
                gain[i * N + j] = of->gain[j * k + i];
    else if (!definite)
        return 0;
    else {
        memcpy(gain, HP, sizeof gain);
        solved(U, k, N, gain);
    }
    memcpy(moved, x, sizeof moved);
    for (int l = 0; l < k; l++)
        add_row(moved, c->innovation[l], gain + l * N);
    memcpy(PA, P, sizeof PA);
    for (int j = 0; j < N; j++)
        for (int l = 0; l < k; l++)
            add_row(PA + j * N, -HP[l * N + j], gain + l * N);
    /* A P A' + K R K' = P A' - K (H P A' - R K') */
    memset(rest, 0, sizeof rest);
    for (int l = 0; l < k; l++) {
        for (int j = 0; j < N; j++)
            if (H[l * N + j] != 0)
                add_row(rest + l * N, H[l * N + j], PA + j * N);
        for (int m = 0; m < k; m++)
            add_row(rest + l * N, -R_y[m * k + l], gain + m * N);
    }
    for (int j = 0; j < N; j++) {
        for (int l = 0; l < k; l++)
            add_row(PA + j * N, -gain[l * N + j], rest + l * N);
        for (int i = 0; i < j; i++)
            PA[j * N + i] = PA[i * N + j];
    }
    arrived(moved, x, PA, c->x, c->P);
    return 1;
}

FAST static int predicted(loop_state *s, real dt, real *x, real *P)
{
    const int count = parts(dt);
    real F[N * N], Q[N * N], moved[N];
    for (int k = 0; k < count; k++) {
        if (linearized(s, x, s->input, dt / (real)count, moved, F, Q) != DONE)
            return 0;
        memcpy(x, moved, sizeof moved);
        sandwich(F, Q, P);
    }
    return 1;
}
