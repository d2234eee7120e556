#include "palpate/haptics/safety.h"
