#include "palpate/haptics/haptic_loop.h"
