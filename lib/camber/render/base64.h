#pragma once

#include <string>

namespace camber {

/// Bytes in the letters of RFC 4648, section 4, for data URIs.
std::string base64(const std::string& bytes);

}  // namespace camber
