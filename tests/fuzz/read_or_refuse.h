#pragma once

#include "camber/core/errors.h"

/// Calls `reader`, which answers or throws an InputError, as a reader of untrusted files does.
template <typename Reader>
void read_or_refuse(Reader&& reader) {
  try {
    reader();
  } catch (const camber::InputError&) {
    // refused
  }
}
