/* SPDX-License-Identifier: Apache-2.0
 *
 * Numbers of several members at once, in one wide register: series.c stands behind this text once
 * more.
 */

#undef NAMED
#undef ANY
#undef NUMBER
#undef TRUTH
#define NAMED(function) function##_of_lanes
#define NUMBER lanes
#define TRUTH lanes_truth
#define ANY(known) any_lane(known)
#if defined(__GNUC__) && ORDER <= 32
#define LANES 4
typedef double lanes __attribute__((vector_size(LANES * sizeof(double))));
typedef long long lanes_truth __attribute__((vector_size(LANES * sizeof(double))));
#define LANE(value, l) (value)[l]
#else
#define LANES 1
typedef double lanes;
typedef int lanes_truth;
#define LANE(value, l) (value)
#endif

INLINE int any_lane(lanes_truth known)
{
    int found = 0;
    for (int l = 0; l < LANES; l++)
        found |= LANE(known, l) != 0;
    return found;
}
