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

/* x + K z, (I - K H) P (I - K H)' + K R K': the Joseph form. 0 if there is no gain. */
FAST static int corrected(const real *x, const real *P, const sensor *of, const real *y,
                     const real *R_y, correction *c)
{
    const int k = of->size;
    real expected[K_MOST], H[K_MOST * N], HP[K_MOST * N], L[K_MOST * K_MOST], K[N * K_MOST];
    real moved[N], AP[N], joseph[N * N];
    of->measure(x, expected);
    of->difference(y, expected, c->innovation);
    of->jacobian(x, H);
    for (int i = 0; i < k; i++)
        for (int j = 0; j < N; j++) {
            HP[i * N + j] = 0;
            for (int l = 0; l < N; l++)
                HP[i * N + j] += H[i * N + l] * P[l * N + j];
        }
    innovation_covariance(HP, H, R_y, k, c->S);
    const int definite = weighed(of, c, L);
    if (of->gain)
        memcpy(K, of->gain, N * (size_t)k * sizeof *K);
    else if (!definite)
        return 0;
    else
        for (int j = 0; j < N; j++) {
            real column[K_MOST];
            for (int i = 0; i < k; i++)
                column[i] = HP[i * N + j];
            solved(L, k, column);
            memcpy(K + j * k, column, (size_t)k * sizeof *K);
        }
    /* A P, with A = I - K H; then A P A' + K R K' = A P - (A P H' - K R) K' */
    for (int i = 0; i < N; i++) {
        real APH_KR[K_MOST] = {0};
        moved[i] = x[i];
        memcpy(AP, P + i * N, sizeof AP);
        for (int l = 0; l < k; l++) {
            moved[i] += K[i * k + l] * c->innovation[l];
            for (int j = 0; j < N; j++)
                AP[j] -= K[i * k + l] * HP[l * N + j];
        }
        for (int l = 0; l < k; l++) {
            for (int j = 0; j < N; j++)
                APH_KR[l] += AP[j] * H[l * N + j];
            for (int m = 0; m < k; m++)
                APH_KR[l] -= K[i * k + m] * R_y[m * k + l];
        }
        for (int j = 0; j <= i; j++) {
            real sum = AP[j];
            for (int l = 0; l < k; l++)
                sum -= APH_KR[l] * K[j * k + l];
            joseph[i * N + j] = sum;
            joseph[j * N + i] = sum;
        }
    }
    arrived(moved, x, joseph, c->x, c->P);
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
