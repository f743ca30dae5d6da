#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <stdexcept>

#include "camber/core/atomic_file.h"
#include "camber/core/version.h"
#include "camber/export/detail/crg_format.h"
#include "camber/export/opencrg.h"

namespace camber {
namespace {

/// A header line ends within the columns that FORTRAN readers see.
constexpr std::size_t kColumns = 72;

void check(const CrgData& data) {
  const std::size_t n = data.sections();
  const auto fits = [&](const std::vector<double>& channel) {
    return channel.empty() || channel.size() == n;
  };
  if (data.v.size() < 2 || n < 2 || data.heights.size() != n * data.v.size() || !fits(data.phi) ||
      !fits(data.slope) || !fits(data.banking)) {
    throw std::invalid_argument(
        fmt::format("CrgData: {} heights, {} sections of v, channels of {}, {} and {}, expected at "
                    "least 2 x 2 and equal lengths",
                    data.heights.size(), data.v.size(), data.phi.size(), data.slope.size(),
                    data.banking.size()));
  }
}

/// Lines of at most kColumns characters, none of which looks like the start of a block.
std::string comment_lines(const std::string& comment) {
  std::string out, line;
  const auto flush = [&] {
    if (!line.empty() && line.front() == '$') line.insert(line.begin(), ' ');
    out += line + "\n";
    line.clear();
  };
  for (const char c : comment) {
    if (c == '\n' || line.size() >= kColumns) flush();
    if (c != '\n') line += static_cast<unsigned char>(c) < ' ' || c == 127 ? ' ' : c;
  }
  if (!line.empty()) flush();
  return out;
}

std::string entry(const char* name, double value) {
  return fmt::format("{:<26}= {:.15g}\n", name, value);
}

std::string separator() { return "$" + std::string(kColumns - 1, '*') + "\n"; }

std::string header(const CrgData& data) {
  std::string out = "$CT\n" + comment_lines(data.comment) + separator() + "$ROAD_CRG\n";
  const auto optional = [&](const char* name, const std::optional<double>& value) {
    if (value) out += entry(name, *value);
  };
  const double end_u = data.start_u + data.increment * static_cast<double>(data.sections() - 1);
  out += entry("REFERENCE_LINE_START_U", data.start_u);
  out += entry("REFERENCE_LINE_START_X", data.start_x);
  out += entry("REFERENCE_LINE_START_Y", data.start_y);
  if (data.has_start_z) out += entry("REFERENCE_LINE_START_Z", data.start_z);
  out += entry("REFERENCE_LINE_START_PHI", data.start_phi);
  out += entry("REFERENCE_LINE_END_U", end_u);
  optional("REFERENCE_LINE_END_X", data.end_x);
  optional("REFERENCE_LINE_END_Y", data.end_y);
  optional("REFERENCE_LINE_END_Z", data.end_z);
  optional("REFERENCE_LINE_END_PHI", data.end_phi);
  out += entry("REFERENCE_LINE_INCREMENT", data.increment);
  out += entry("LONG_SECTION_V_RIGHT", data.v.front());
  out += entry("LONG_SECTION_V_LEFT", data.v.back());
  for (const auto& [name, value] : data.other) {
    std::string upper = name;
    std::transform(upper.begin(), upper.end(), upper.begin(),
                   [](unsigned char c) { return static_cast<char>(std::toupper(c)); });
    out += entry(upper.c_str(), value);
  }
  if (data.modifiers) {
    // Only whether unknown cells stay so: without the block a reader would move the road to the
    // origin and fill them.
    out += separator() + "$ROAD_CRG_MODS\n";
    out += fmt::format("GRID_NAN_MODE = {}\n",
                       static_cast<int>(data.modifiers->unknown.value_or(CrgUnknown::kKeep)));
  }
  out += separator() + "$KD_DEFINITION\n";
  out += fmt::format("#:{}\n", to_string(data.encoding));
  out += fmt::format("U:reference line u,m,{:.9g},{:.9g}\n", data.start_u, data.increment);
  if (!data.phi.empty()) out += "D:reference line phi,rad\n";
  if (!data.banking.empty()) out += "D:reference line banking,m/m\n";
  if (!data.slope.empty()) out += "D:reference line slope,m/m\n";
  for (const double v : data.v) out += fmt::format("D:long section at v = {:.6f},m\n", v);
  out += separator();
  out += std::string(80, '$');
  return out + "\n";
}

void append_number(std::string* out, double value, bool unused, CrgEncoding encoding) {
  const detail::CrgLayout layout = detail::crg_layout(encoding);
  if (layout.text) {
    const auto width = static_cast<std::size_t>(layout.width);
    std::string cell = detail::crg_cell(value, layout.width);
    if (unused) cell = std::string(width - 10, ' ') + "**unused**";
    if (cell.size() != width) {
      throw std::invalid_argument(
          fmt::format("CrgData: {} does not fit into {} characters", value, width));
    }
    *out += cell;
    return;
  }
  std::uint64_t bits = 0;
  if (unused) value = std::numeric_limits<double>::quiet_NaN();
  if (layout.width == 4) {
    // One pattern for all that is not known, the one that readers compare with.
    std::uint32_t half = 0x7fc00000u;
    const float narrow = static_cast<float>(value);
    if (std::isfinite(narrow)) std::memcpy(&half, &narrow, sizeof half);
    bits = half;
  } else {
    bits = 0x7ff8000000000000u;
    if (std::isfinite(value)) std::memcpy(&bits, &value, sizeof bits);
  }
  for (int shift = (layout.width - 1) * 8; shift >= 0; shift -= 8) {
    *out += static_cast<char>(bits >> shift & 0xffu);
  }
}

}  // namespace

void write_crg(const CrgData& data, std::ostream& out) {
  check(data);
  out << header(data);
  const detail::CrgLayout layout = detail::crg_layout(data.encoding);
  std::string record;
  for (std::size_t i = 0; i < data.sections(); ++i) {
    record.clear();
    int column = 0;
    const auto put = [&](double value, bool unused) {
      if (layout.text && column == layout.per_line) record += '\n', column = 0;
      append_number(&record, value, unused, data.encoding);
      ++column;
    };
    if (!data.phi.empty()) put(data.phi[i], i == 0);
    if (!data.banking.empty()) put(data.banking[i], false);
    if (!data.slope.empty()) put(data.slope[i], i == 0);
    for (std::size_t j = 0; j < data.v.size(); ++j) {
      put(data.heights[i * data.v.size() + j], false);
    }
    if (layout.text) record += '\n';
    out << record;
  }
}

void write_crg(const CrgData& data, const std::filesystem::path& path) {
  check(data);
  write_file_atomically(path, [&](std::ostream& out) { write_crg(data, out); });
}

}  // namespace camber
