/* Written by kalman_ros export: see NAME.h. */

#include "NAME.h"

#include <math.h>
#include <string.h>

typedef NAME_real real;
typedef NAME_loop loop_state;

#define FAST
#define INLINE static inline
#define R(number) ((real)(number))
