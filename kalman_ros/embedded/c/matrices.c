/* P = F P F' + Q, in place */
INLINE void sandwich(const real *F, const real *Q, real *P)
{
    real FP[N * N];
    for (int i = 0; i < N; i++) {
        for (int j = 0; j < N; j++)
            FP[i * N + j] = 0;
        for (int k = 0; k < N; k++)
            for (int j = 0; j < N; j++)
                FP[i * N + j] += F[i * N + k] * P[k * N + j];
    }
    for (int i = 0; i < N; i++)
        for (int j = 0; j <= i; j++) {
            real sum = (Q[i * N + j] + Q[j * N + i]) / 2;
            for (int k = 0; k < N; k++)
                sum += FP[i * N + k] * F[j * N + k];
            P[i * N + j] = sum;
            P[j * N + i] = sum;
        }
}

/* L, lower triangular, with L L' = A of n rows; 0 if there is none. A coordinate that is certain,
 * with a row of zeros, stays certain where that may be.
 */
static int factored(const real *A, int n, int may_be_certain, real *L)
{
    for (int j = 0; j < n; j++) {
        real sum = A[j * n + j];
        int certain = may_be_certain && A[j * n + j] == 0;
        for (int k = 0; k < j; k++)
            sum -= L[j * n + k] * L[j * n + k];
        if (!certain && !(sum > 0 && sum < INFINITY))
            return 0;
        L[j * n + j] = certain ? 0 : sqrt(sum);
        for (int i = 0; i < n; i++) {
            if (i < j)
                L[i * n + j] = 0;
            if (i <= j)
                continue;
            sum = A[i * n + j];
            for (int k = 0; k < j; k++)
                sum -= L[i * n + k] * L[j * n + k];
            L[i * n + j] = certain ? 0 : sum / L[j * n + j];
        }
    }
    return 1;
}

/* The n rows of B, of some width, become A^-1 B, with A = L L' */
INLINE void solved(const real *L, int n, int width, real *B)
{
    for (int i = 0; i < n; i++) {
        for (int k = 0; k < i; k++)
            for (int j = 0; j < width; j++)
                B[i * width + j] -= L[i * n + k] * B[k * width + j];
        for (int j = 0; j < width; j++)
            B[i * width + j] /= L[i * n + i];
    }
    for (int i = n - 1; i >= 0; i--) {
        for (int j = 0; j < width; j++)
            B[i * width + j] /= L[i * n + i];
        for (int k = 0; k < i; k++)
            for (int j = 0; j < width; j++)
                B[k * width + j] -= L[i * n + k] * B[i * width + j];
    }
}

/* Whether numbers are finite, and none is so large that its square is not. */
static int are_finite(const real *numbers, int count)
{
    real sum = 0;
    for (int i = 0; i < count; i++)
        sum += numbers[i] * numbers[i];
    return isfinite(sum);
}

/* A factor of P, which is repaired where rounding made it indefinite: then 1 is added to repairs.
 * 0 if there is none.
 */
static int repaired(real *P, real *L, uint32_t *repairs)
{
    static const real sizes[] = REPAIRS;
    real whole[N * N], largest = 0;
    int certain = 0;
    if (!are_finite(P, N * N))
        return 0;
    for (int i = 0; i < N; i++) {
        largest = fmax(largest, P[i * N + i]);
        if (P[i * N + i] == 0)
            certain = 1;
    }
    for (int i = 0; i < N && certain; i++)
        for (int j = 0; j < N; j++)
            if (P[i * N + i] == 0 && P[i * N + j] != 0)
                certain = 0;
    if (factored(P, N, certain, L))
        return 1;
    for (int k = 0; k < 4; k++) {
        memcpy(whole, P, sizeof whole);
        for (int i = 0; i < N; i++)
            if (!certain || P[i * N + i] != 0)
                whole[i * N + i] += sizes[k] * largest;
        if (largest > 0 && factored(whole, N, certain, L)) {
            memcpy(P, whole, sizeof whole);
            *repairs += 1;
            return 1;
        }
    }
    return 0;
}
