/* SPDX-License-Identifier: Apache-2.0
 *
 * What a sensor reads, and how that changes with the state: N states, K numbers of a
 * reading, COUNT numbers of the sensor.
 *
 * v holds count states, and receives the results behind them; each member has the next of sets
 * of numbers.
 */

#define EACH(k, count) \
    for (long k = 0; k < count; k++, x += N, p = k % sets ? p + COUNT : first)

void readings(double *v, long count, const double *first, long sets)
{
    const double *x = v, *p = first;
    double *y = v + count * N;
    EACH(k, count) {
        measure(x, p, y);
        y += K;
    }
}

/* the reading of one state, and H row by row */
void sensed(const double *x, const double *p, double *y, double *H)
{
    double h[H_COUNT + 1];
    measure(x, p, y);
    jacobian(x, p, h);
    memset(H, 0, K * N * sizeof *H);
    for (int i = 0; i < H_COUNT; i++)
        H[H_ROW[i] * N + H_COLUMN[i]] = h[i];
}

/* each H column by column */
void slopes(double *v, long count, const double *first, long sets)
{
    const double *x = v, *p = first;
    double *H = v + count * N;
    memset(H, 0, count * N * K * sizeof *H);
    EACH(k, count) {
        double h[H_COUNT + 1];
        jacobian(x, p, h);
        for (int i = 0; i < H_COUNT; i++)
            H[H_COLUMN[i] * K + H_ROW[i]] = h[i];
        H += N * K;
    }
}
