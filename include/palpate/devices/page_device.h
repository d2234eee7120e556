// A hand in a browser: a page moves the handle, and shows what it feels.
#pragma once

#include <memory>

#include "palpate/haptics/page_handle.h"

namespace palpate {

/// A device that ticks a thousand times a second and follows the page that holds its handle, by a
/// critically damped motion and never faster than 1 m/s or 10 rad/s. Button 0 is down while a page
/// holds it and its poses are fresh. Who lets go, falls silent or goes away leaves a handle that
/// gives way to what it feels for half a second, and then stays, with the button up.
std::unique_ptr<HapticDevice> make_page_device(std::shared_ptr<PageHandle> handle);

}  // namespace palpate
