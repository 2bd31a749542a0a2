/* Written by kalman_ros export: see NAME.h. */

#include "NAME.h"

#include <math.h>
#include <string.h>

typedef NAME_real real;
typedef NAME_loop loop_state;

#define R(number) ((real)(number))
