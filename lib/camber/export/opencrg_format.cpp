#include <algorithm>
#include <charconv>
#include <cmath>

#include "camber/export/detail/crg_format.h"
#include "camber/export/opencrg.h"

namespace camber {

std::string_view to_string(CrgEncoding encoding) {
  switch (encoding) {
    case CrgEncoding::kTextDouble:
      return "LDFI";
    case CrgEncoding::kBinary:
      return "KRBI";
    case CrgEncoding::kBinaryDouble:
      return "KDBI";
    case CrgEncoding::kText:
      break;
  }
  return "LRFI";
}

CrgModifiers CrgModifiers::defaults() {
  CrgModifiers modifiers;
  modifiers.unknown = CrgUnknown::kLast;
  return modifiers;
}

namespace detail {

CrgLayout crg_layout(CrgEncoding encoding) {
  switch (encoding) {
    case CrgEncoding::kTextDouble:
      return {20, 4, true};
    case CrgEncoding::kBinary:
      return {4, 0, false};
    case CrgEncoding::kBinaryDouble:
      return {8, 0, false};
    case CrgEncoding::kText:
      break;
  }
  return {10, 8, true};
}

std::string crg_cell(double value, int width) {
  if (!std::isfinite(value)) {
    return std::string(static_cast<std::size_t>(width - 9), ' ') + "*missing*";
  }
  // As many decimals as fit behind the digits before the point, without an exponent, which other
  // readers count in columns of their own.
  std::string text;
  for (int decimals = width - 3; decimals >= 0; --decimals) {
    char buffer[400];
    const auto end =
        std::to_chars(buffer, buffer + sizeof buffer, value, std::chars_format::fixed, decimals);
    text.assign(buffer, end.ptr);
    if (text.size() <= static_cast<std::size_t>(width)) break;
  }
  if (text.size() > static_cast<std::size_t>(width)) return {};
  return std::string(static_cast<std::size_t>(width) - text.size(), ' ') + text;
}

}  // namespace detail

double crg_rounded(double value, CrgEncoding encoding) {
  if (!std::isfinite(value)) return value;
  if (encoding == CrgEncoding::kBinary) return static_cast<float>(value);
  if (encoding == CrgEncoding::kBinaryDouble) return value;
  const std::string text = detail::crg_cell(value, detail::crg_layout(encoding).width);
  double back = std::numeric_limits<double>::quiet_NaN();
  std::from_chars(text.data() + std::min(text.find_first_not_of(' '), text.size()),
                  text.data() + text.size(), back);
  return back;
}

}  // namespace camber
