#include "../ecmsk_msvc.h"
