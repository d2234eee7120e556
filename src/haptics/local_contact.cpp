#include "palpate/haptics/local_contact.h"
