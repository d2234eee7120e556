#include "palpate/haptics/coupling.h"
