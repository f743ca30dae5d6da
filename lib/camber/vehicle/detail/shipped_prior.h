#pragma once

namespace camber {

/// Text of shipped_prior.json, put into the library by the build.
extern const char* const kShippedPriorText;

}  // namespace camber
