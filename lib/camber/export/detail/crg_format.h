#pragma once

#include <string>

#include "camber/export/opencrg.h"

namespace camber::detail {

/// Numbers of a record: `width` characters or bytes each; text has `per_line` of them a line.
struct CrgLayout {
  int width = 10;
  int per_line = 8;
  bool text = true;
};
CrgLayout crg_layout(CrgEncoding encoding);

/// A number in `width` characters, "*missing*" where it is not finite; empty if it does not fit.
std::string crg_cell(double value, int width);

}  // namespace camber::detail
