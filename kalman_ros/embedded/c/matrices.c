/* P = F P F' + Q, in place; F becomes its transpose, so that rows are added */
INLINE void sandwich(real *F, const real *Q, real *P)
{
    real FP[N * N];
    for (int i = 0; i < N; i++) {
        real row[N] = {0};
        for (int k = 0; k < N; k++)
            for (int j = 0; j < N; j++)
                row[j] += F[i * N + k] * P[k * N + j];
        memcpy(FP + i * N, row, sizeof row);
    }
    for (int i = 0; i < N; i++)
        for (int j = 0; j < i; j++) {
            const real above = F[j * N + i];
            F[j * N + i] = F[i * N + j];
            F[i * N + j] = above;
        }
    for (int i = 0; i < N; i++) {
        real row[N];
        for (int j = 0; j < (WIDE ? N : i + 1); j++)
            row[j] = (Q[i * N + j] + Q[j * N + i]) / 2;
        for (int k = 0; k < N; k++)
            for (int j = 0; j < (WIDE ? N : i + 1); j++)
                row[j] += FP[i * N + k] * F[k * N + j];
        for (int j = 0; j <= i; j++) {
            P[i * N + j] = row[j];
            P[j * N + i] = row[j];
        }
    }
}

/* U, upper triangular, with U' U = A of n rows; 0 if there is none. A coordinate that is certain,
 * with a row of zeros, stays certain where that may be.
 */
INLINE int factored(const real *A, int n, int may_be_certain, real *U)
{
    real row[N > K_MOST ? N : K_MOST];
    memset(U, 0, (size_t)(n * n) * sizeof *U);
    for (int j = 0; j < n; j++) {
        const int certain = may_be_certain && A[j * n + j] == 0;
        for (int i = WIDE ? 0 : j; i < n; i++)
            row[i] = A[j * n + i];
        for (int k = 0; k < j; k++)
            for (int i = WIDE ? 0 : j; i < n; i++)
                row[i] -= U[k * n + j] * U[k * n + i];
        if (!certain && !(row[j] > 0 && row[j] < INFINITY))
            return 0;
        const real pivot = certain ? 0 : sqrt(row[j]);
        U[j * n + j] = pivot;
        for (int i = j + 1; i < n; i++)
            U[j * n + i] = certain ? 0 : row[i] / pivot;
    }
    return 1;
}

/* The n rows of B, of some width, become A^-1 B, with A = U' U */
INLINE void solved(const real *U, int n, int width, real *B)
{
    for (int i = 0; i < n; i++) {
        for (int k = 0; k < i; k++)
            for (int j = 0; j < width; j++)
                B[i * width + j] -= U[k * n + i] * B[k * width + j];
        for (int j = 0; j < width; j++)
            B[i * width + j] /= U[i * n + i];
    }
    for (int i = n - 1; i >= 0; i--) {
        for (int j = 0; j < width; j++)
            B[i * width + j] /= U[i * n + i];
        for (int k = 0; k < i; k++)
            for (int j = 0; j < width; j++)
                B[k * width + j] -= U[k * n + i] * B[i * width + j];
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
static int repaired(real *P, real *U, uint32_t *repairs)
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
    if (factored(P, N, certain, U))
        return 1;
    for (int k = 0; k < 4; k++) {
        memcpy(whole, P, sizeof whole);
        for (int i = 0; i < N; i++)
            if (!certain || P[i * N + i] != 0)
                whole[i * N + i] += sizes[k] * largest;
        if (largest > 0 && factored(whole, N, certain, U)) {
            memcpy(P, whole, sizeof whole);
            *repairs += 1;
            return 1;
        }
    }
    return 0;
}
