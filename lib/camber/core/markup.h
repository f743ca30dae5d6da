#pragma once

#include <string>

namespace camber {

/// Text as it stands in XML and HTML, in elements and in attributes.
std::string escaped_markup(const std::string& text);

}  // namespace camber
