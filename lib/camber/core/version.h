#pragma once

namespace camber {

/// Version of the library and of the programs, as written to every result.
inline constexpr const char* kVersion = "0.1.0";

}  // namespace camber
