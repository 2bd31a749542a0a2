/* SPDX-License-Identifier: Apache-2.0
 *
 * Rates of members in continuous time. What stands before this text is members.c.
 */

void rates(double *v, long count, const double *first, long sets)
{
    const double *x = v, *u = x + count * N, *p = first;
    double *rate = v + count * (N + M);
    EACH(k, count) {
        derivative(x, u, p, rate);
        rate += N;
    }
}
