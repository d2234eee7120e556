#include "palpate/devices/open_device.h"
