// The version of Palpate. The build reads the number here.
#pragma once

#define PALPATE_VERSION "0.1.0"
