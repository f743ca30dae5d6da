#pragma once

#include <string>
#include <vector>

namespace camber::tools {

/// The name that was most likely meant: the nearest by Damerau's distance (a letter inserted, left
/// out, replaced, or two neighbours swapped; restricted, that is, no part is changed twice), or one
/// of which `typed` is the beginning. Empty where none is near: more than a third of the letters
/// differ. Of equally near ones, the first.
std::string nearest_name(const std::string& typed, const std::vector<std::string>& names);

}  // namespace camber::tools
