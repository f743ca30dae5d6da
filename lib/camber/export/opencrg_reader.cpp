// ASAM OpenCRG 1.1 and 1.2, "OpenCRG User Manual": blocks of a text header, then records.

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <functional>
#include <map>
#include <string_view>

#include "camber/cloud/file_reader.h"
#include "camber/cloud/number_text.h"
#include "camber/core/errors.h"
#include "camber/core/lower_case.h"
#include "camber/core/read_file.h"
#include "camber/core/referred_file.h"
#include "camber/export/detail/crg_format.h"
#include "camber/export/opencrg.h"

namespace fs = std::filesystem;

namespace camber {
namespace {

constexpr std::size_t kHeaderLine = 4096;      // bytes, limit of a header line
constexpr std::size_t kMostChannels = 100000;  // columns of a record
constexpr int kMostFiles = 8;                  // that name each other

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

std::string_view trimmed(std::string_view text) {
  while (!text.empty() && (is_blank(text.front()) || text.front() == '\n')) text.remove_prefix(1);
  while (!text.empty() && (is_blank(text.back()) || text.back() == '\n')) text.remove_suffix(1);
  return text;
}

bool starts_with(std::string_view text, std::string_view start) {
  return text.substr(0, start.size()) == start;
}

enum class Block { kNone, kComment, kRoad, kOptions, kModifiers, kFile, kDefinition, kUnknown };

/// What a column of the records holds.
struct Channel {
  enum class Kind { kPhi, kSlope, kBanking, kSection } kind = Kind::kSection;
  double place = 0.0;  ///< of a section: v, m, or its number
};

/// Reads one file; those that it names are read by further ones into the same data.
class Reader {
 public:
  Reader(const fs::path& path, const fs::path& folder, CrgData* data, int depth)
      : path_(path), folder_(folder), file_(path), lines_(file_), data_(*data), depth_(depth) {}

  void read();
  bool has_options() const { return has_options_; }

 private:
  void header_line(std::string_view line);
  void begin_block(std::string_view line);
  void finish_block();
  void road_entry(const std::string& key, double value);
  void option_entry(const std::string& key, double value);
  void modifier_entry(const std::string& key, double value);
  void definition(std::string_view line);
  void add_section(std::string_view what);
  void read_named_file();
  void finish_header();
  void place_sections();
  void read_records();
  void read_text_records(std::size_t expected);
  void read_binary_records(std::size_t expected);
  void take_record(const std::vector<double>& values);
  double cell(std::string_view text) const;
  std::size_t announced_sections() const;
  double entry_value(std::string_view line, std::string_view what);

  fs::path path_;
  fs::path folder_;  // in which named files must lie; empty: anywhere
  FileReader file_;
  LineReader lines_;
  CrgData& data_;
  int depth_ = 0;
  Block block_ = Block::kNone;
  bool in_records_ = false, has_file_ = false;
  bool has_format_ = false, has_options_ = false;
  std::string named_;  // of $ROAD_CRG_FILE
  std::optional<double> v_right_, v_left_, v_increment_;
  bool by_number_ = false, by_place_ = false;
  std::vector<Channel> channels_;
  std::vector<std::size_t> order_;  // of the sections' channels, right to left
};

void Reader::begin_block(std::string_view line) {
  const std::string name = lower_case(next_word(line));
  static const std::map<std::string, Block> kBlocks = {{"$ct", Block::kComment},
                                                       {"$road_crg", Block::kRoad},
                                                       {"$road_crg_opts", Block::kOptions},
                                                       {"$road_crg_mods", Block::kModifiers},
                                                       {"$road_crg_file", Block::kFile},
                                                       {"$kd_definition", Block::kDefinition}};
  if (starts_with(name, "$$$$")) {
    in_records_ = true;
    return;
  }
  block_ = Block::kNone;
  if (name == "$" || name[1] == '!' || name[1] == '*') return;
  const auto found = kBlocks.find(name.substr(0, name.find('!')));
  if (found == kBlocks.end()) {
    block_ = Block::kUnknown;
    data_.remarks.push_back(
        fmt::format("line {}: block {} is not known and was left out", lines_.line(), shown(name)));
    return;
  }
  block_ = found->second;
  // A block replaces what a file named before has set.
  if (block_ == Block::kOptions) data_.options = CrgOptions(), has_options_ = true;
  if (block_ == Block::kModifiers) data_.modifiers = CrgModifiers();
}

void Reader::finish_block() {
  if (block_ == Block::kFile) read_named_file();
  block_ = Block::kNone;
}

void Reader::header_line(std::string_view line) {
  if (!line.empty() && line.front() == '$') {
    finish_block();
    begin_block(line);
    return;
  }
  if (block_ == Block::kComment) {
    // The comment behind the block's name counts, too, but is a remark of whoever wrote it.
    if (data_.comment.size() < (1u << 16)) data_.comment += std::string(line) + "\n";
    return;
  }
  line = trimmed(line.substr(0, line.find('!')));
  if (line.empty() || line.front() == '*') return;
  const std::string key = lower_case(trimmed(line.substr(0, line.find('='))));
  switch (block_) {
    case Block::kRoad:
      return road_entry(key, entry_value(line, "$ROAD_CRG"));
    case Block::kOptions:
      return option_entry(key, entry_value(line, "$ROAD_CRG_OPTS"));
    case Block::kModifiers:
      return modifier_entry(key, entry_value(line, "$ROAD_CRG_MODS"));
    case Block::kFile:
      if (named_.size() + line.size() > 4096) lines_.fail("the name of the file is too long");
      named_ += line;
      return;
    case Block::kDefinition:
      return definition(line);
    default:
      return;
  }
}

double Reader::entry_value(std::string_view line, std::string_view what) {
  const std::size_t equals = line.find('=');
  if (equals == std::string_view::npos) {
    lines_.fail(fmt::format("{}: found {}, expected NAME = NUMBER", what, shown(line)));
  }
  std::string text(trimmed(line.substr(equals + 1)));
  for (char& c : text) {
    if (c == 'd' || c == 'D') c = 'e';  // FORTRAN's exponent
  }
  const ParsedNumber number = parse_number(text.data(), text.data() + text.size());
  if (number.end == nullptr || text.empty() || !std::isfinite(number.value)) {
    lines_.fail(fmt::format("{}: found {}, expected a number", what, shown(text)));
  }
  // ASAM's own sample has "2.000000000+e00".
  if (number.end != text.data() + text.size()) {
    data_.remarks.push_back(
        fmt::format("line {}: {} was read as {}", lines_.line(), shown(text), number.value));
  }
  return number.value;
}

void Reader::road_entry(const std::string& key, double value) {
  CrgData& d = data_;
  const std::map<std::string, std::function<void()>> entries = {
      {"reference_line_start_u", [&] { d.start_u = value; }},
      {"reference_line_start_x", [&] { d.start_x = value; }},
      {"reference_line_start_y", [&] { d.start_y = value; }},
      {"reference_line_start_z", [&] { d.start_z = value, d.has_start_z = true; }},
      {"reference_line_start_phi", [&] { d.start_phi = value; }},
      {"reference_line_start_b", [&] { d.start_banking = value; }},
      {"reference_line_start_s", [&] { d.start_slope = value; }},
      {"reference_line_end_u", [&] { d.end_u = value; }},
      {"reference_line_end_x", [&] { d.end_x = value; }},
      {"reference_line_end_y", [&] { d.end_y = value; }},
      {"reference_line_end_z", [&] { d.end_z = value; }},
      {"reference_line_end_phi", [&] { d.end_phi = value; }},
      {"reference_line_increment", [&] { d.increment = value; }},
      {"long_section_v_right", [&] { v_right_ = value; }},
      {"long_section_v_left", [&] { v_left_ = value; }},
      {"long_section_v_increment", [&] { v_increment_ = value; }}};
  const auto found = entries.find(key);
  if (found == entries.end()) {
    d.other.emplace_back(key, value);
  } else {
    found->second();
  }
  if (!(d.increment > 0.0)) {
    lines_.fail(fmt::format("REFERENCE_LINE_INCREMENT is {}, expected > 0", d.increment));
  }
}

void Reader::option_entry(const std::string& key, double value) {
  const auto border = [&] {
    if (value < 0.0 || value > 4.0 || value != std::floor(value)) {
      lines_.fail(fmt::format("{} is {}, expected 0 to 4", key, value));
    }
    return static_cast<CrgBorder>(static_cast<int>(value));
  };
  const auto length = [&]() -> std::optional<double> {
    if (value > 0.0) return value;
    if (value < 0.0) lines_.fail(fmt::format("{} is {}, expected >= 0", key, value));
    return std::nullopt;
  };
  CrgOptions& o = data_.options;
  if (key == "border_mode_u") o.border_u = border();
  if (key == "border_mode_v") o.border_v = border();
  if (key == "border_offset_u") o.offset_u = value;
  if (key == "border_offset_v") o.offset_v = value;
  if (key == "border_smooth_ubeg") o.smooth_begin = length();
  if (key == "border_smooth_uend") o.smooth_end = length();
  if (key == "refline_continuation") {
    if (value != 0.0 && value != 1.0) {
      lines_.fail(fmt::format("{} is {}, expected 0 or 1", key, value));
    }
    o.close_track = value == 1.0;
  }
  // The others concern messages, searches and checks of a reader, not the road.
}

void Reader::modifier_entry(const std::string& key, double value) {
  CrgModifiers& m = *data_.modifiers;
  if (key == "grid_nan_mode") {
    if (value != 0.0 && value != 1.0 && value != 2.0) {
      lines_.fail(fmt::format("{} is {}, expected 0, 1 or 2", key, value));
    }
    m.unknown = static_cast<CrgUnknown>(static_cast<int>(value));
    return;
  }
  const std::map<std::string, std::optional<double>*> optional = {
      {"scale_z_grid", &m.scale_heights},   {"scale_slope", &m.scale_slope},
      {"scale_banking", &m.scale_banking},  {"scale_length", &m.scale_length},
      {"scale_width", &m.scale_width},      {"scale_curvature", &m.scale_curvature},
      {"refpoint_u", &m.point_u},           {"refpoint_u_fraction", &m.point_u_fraction},
      {"refpoint_v", &m.point_v},           {"refpoint_v_fraction", &m.point_v_fraction},
      {"refpoint_x", &m.point_x},           {"refpoint_y", &m.point_y},
      {"refpoint_z", &m.point_z},           {"refpoint_phi", &m.point_phi},
      {"refline_offset_x", &m.offset_x},    {"refline_offset_y", &m.offset_y},
      {"refline_offset_z", &m.offset_z},    {"refline_offset_phi", &m.offset_phi},
      {"refline_rotcenter_x", &m.centre_x}, {"refline_rotcenter_y", &m.centre_y}};
  const std::map<std::string, double*> plain = {{"grid_nan_offset", &m.unknown_offset},
                                                {"refpoint_u_offset", &m.point_u_offset},
                                                {"refpoint_v_offset", &m.point_v_offset}};
  if (const auto found = optional.find(key); found != optional.end()) {
    constexpr double kLeast = 1e-6, kMost = 1e6;  // lengths stay numbers to compute with
    if ((key == "scale_length" || key == "scale_width") && !(value >= kLeast && value <= kMost)) {
      lines_.fail(fmt::format("{} is {}, expected {} to {}", key, value, kLeast, kMost));
    }
    *found->second = value;
  } else if (const auto other = plain.find(key); other != plain.end()) {
    *other->second = value;
  } else {
    data_.remarks.push_back(
        fmt::format("line {}: the modifier {} is not known", lines_.line(), shown(key)));
  }
}

void Reader::add_section(std::string_view what) {
  Channel channel;
  const std::size_t at = what.find("at v");
  std::string text;
  if (at != std::string_view::npos) {
    const std::size_t equals = what.find('=', at);
    if (equals == std::string_view::npos) lines_.fail("a long section without '=' behind 'at v'");
    text = trimmed(what.substr(equals + 1));
    by_place_ = true;
  } else {
    text = trimmed(what.substr(std::strlen("long section")));
    by_number_ = true;
  }
  const ParsedNumber number = parse_number(text.data(), text.data() + text.size());
  if (number.end == nullptr || text.empty() || number.end != text.data() + text.size() ||
      !std::isfinite(number.value)) {
    lines_.fail(
        fmt::format("long section: found {}, expected its number or 'at v = PLACE'", shown(text)));
  }
  channel.place = number.value;
  channels_.push_back(channel);
}

void Reader::definition(std::string_view line) {
  if (starts_with(line, "#:")) {
    const std::string name(trimmed(line.substr(2)));
    has_format_ = false;
    for (const CrgEncoding encoding : {CrgEncoding::kText, CrgEncoding::kTextDouble,
                                       CrgEncoding::kBinary, CrgEncoding::kBinaryDouble}) {
      if (lower_case(name) == lower_case(to_string(encoding))) {
        data_.encoding = encoding;
        has_format_ = true;
      }
    }
    if (!has_format_) {
      lines_.fail(
          fmt::format("data format: found {}, expected LRFI, LDFI, KRBI or KDBI", shown(name)));
    }
    return;
  }
  const std::string text = lower_case(line);
  if (starts_with(text, "u:")) return;  // for programs that draw it
  if (!starts_with(text, "d:")) {
    lines_.fail(fmt::format("found {}, expected '#:', 'U:' or 'D:'", shown(line)));
  }
  if (channels_.size() >= kMostChannels) {
    lines_.fail(fmt::format("found more than {} channels", kMostChannels));
  }
  const std::size_t comma = text.rfind(',');
  const std::string_view what =
      trimmed(std::string_view(text).substr(2, comma == std::string::npos ? comma : comma - 2));
  const std::string_view unit =
      comma == std::string::npos ? "" : trimmed(std::string_view(text).substr(comma + 1));
  const auto unit_is = [&](std::string_view expected) {
    if (unit == expected) return;
    lines_.fail(fmt::format("{}: found unit {}, expected {}", what, shown(unit), expected));
  };
  if (starts_with(what, "long section")) {
    unit_is("m");
    return add_section(what);
  }
  if (what == "reference line phi") {
    unit_is("rad");
    channels_.push_back({Channel::Kind::kPhi, 0.0});
  } else if (what == "reference line banking") {
    unit_is("m/m");
    channels_.push_back({Channel::Kind::kBanking, 0.0});
  } else if (what == "reference line slope") {
    unit_is("m/m");
    channels_.push_back({Channel::Kind::kSlope, 0.0});
  } else {
    lines_.fail(
        fmt::format("channel: found {}, expected reference line phi, banking or slope, or "
                    "long section",
                    shown(what)));
  }
}

/// The name with variables of the environment in it, up to the next slash each.
std::string with_variables(const std::string& name, const std::function<void(std::string)>& fail) {
  std::string out;
  for (std::size_t i = 0; i < name.size();) {
    if (name[i] != '$') {
      out += name[i++];
      continue;
    }
    const std::size_t end = std::min(name.find('/', i), name.size());
    const std::string variable = name.substr(i + 1, end - i - 1);
    const char* const value = std::getenv(variable.c_str());
    if (value == nullptr) {
      fail(fmt::format("the file {} needs the variable {}, which is not set", shown(name),
                       shown(variable)));
    }
    out += value;
    i = end;
  }
  return out;
}

void Reader::read_named_file() {
  if (named_.empty()) lines_.fail("$ROAD_CRG_FILE names no file");
  if (has_file_) lines_.fail("found a second $ROAD_CRG_FILE");
  if (depth_ + 1 >= kMostFiles) {
    lines_.fail(fmt::format("found more than {} files that name each other", kMostFiles));
  }
  has_file_ = true;
  const fs::path name =
      with_variables(named_, [this](const std::string& reason) { lines_.fail(reason); });
  std::error_code error;
  fs::path found = path_.parent_path() / name;
  if (!fs::exists(found, error)) found = name;
  if (!folder_.empty() && !lies_below(found, folder_)) throw OutsideFolderError(path_.string());
  if (!fs::is_regular_file(found, error)) {
    // Not `name`, in which variables of the environment have their values.
    lines_.fail(fmt::format("the file {} that it names is not there", shown(named_)));
  }
  if (std::any_of(data_.files.begin(), data_.files.end(),
                  [&](const fs::path& read) { return fs::equivalent(read, found, error); })) {
    lines_.fail("found files that name each other");
  }
  const std::optional<CrgModifiers> modifiers = data_.modifiers;
  const CrgOptions options = data_.options;
  const bool named_options = read_referred_file(
      found, "an OpenCRG file", [&](const std::string& remark) { data_.remarks.push_back(remark); },
      [&](const LogSink& count_remark) {
        Reader reader(found, folder_, &data_, depth_ + 1);
        const std::vector<std::string> own_remarks = data_.remarks;
        reader.read();
        std::for_each(data_.remarks.begin() + static_cast<std::ptrdiff_t>(own_remarks.size()),
                      data_.remarks.end(), count_remark);
        data_.remarks = own_remarks;
        return reader.has_options();
      });
  if (has_options_) data_.options = options;
  if (modifiers) data_.modifiers = modifiers;
  has_options_ = has_options_ || named_options;
}

void Reader::place_sections() {
  std::vector<std::size_t>& order = order_;
  for (std::size_t i = 0; i < channels_.size(); ++i) {
    if (channels_[i].kind == Channel::Kind::kSection) order.push_back(i);
  }
  const std::string name = path_.string();
  if (order.size() < 2) {
    throw InputError(name, "header",
                     fmt::format("found {} long sections, expected at least 2", order.size()));
  }
  if (by_number_ && by_place_) {
    throw InputError(name, "header", "found long sections both by number and by place");
  }
  std::stable_sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) {
    return channels_[a].place < channels_[b].place;
  });
  const double n = static_cast<double>(order.size());
  data_.numbered = by_number_;
  if (by_number_) {
    const double step = v_increment_          ? *v_increment_
                        : v_right_ && v_left_ ? (*v_left_ - *v_right_) / (n - 1.0)
                                              : 0.01;
    if (!(step > 1e-6)) {
      throw InputError(name, "header",
                       fmt::format("LONG_SECTION_V_INCREMENT is {}, expected > 1e-6", step));
    }
    if (!v_right_) {
      data_.remarks.push_back(
          "no LONG_SECTION_V_RIGHT: the rightmost long section counts as v = 0, as ASAM's C reader "
          "has it");
    }
    for (std::size_t i = 0; i < order.size(); ++i) {
      if (channels_[order[i]].place != static_cast<double>(i + 1)) {
        throw InputError(
            name, "header",
            fmt::format("found long section {}, expected {}", channels_[order[i]].place, i + 1));
      }
      data_.v.push_back(v_right_.value_or(0.0) + static_cast<double>(i) * step);
    }
  } else {
    for (const std::size_t i : order) data_.v.push_back(channels_[i].place);
  }
  for (std::size_t i = 1; i < data_.v.size(); ++i) {
    if (data_.v[i] - data_.v[i - 1] < 1e-6) {
      throw InputError(name, "header",
                       fmt::format("found two long sections at v = {}", data_.v[i]));
    }
  }
  data_.v_right = v_right_.value_or(data_.v.front());
  data_.v_left = v_left_.value_or(data_.v.back());
}

void Reader::finish_header() {
  if (!data_.v.empty()) lines_.fail("found a second set of records, beside that of the file named");
  if (!has_format_) lines_.fail("found records, expected '#:' with the data format before");
  place_sections();
}

std::size_t Reader::announced_sections() const {
  if (!data_.end_u) return 0;
  const double steps = (*data_.end_u - data_.start_u) / data_.increment;
  if (!(steps >= 0.5 && steps < 1e12)) {
    throw InputError(path_.string(), "header",
                     fmt::format("the reference line runs from u = {} to {} in steps of {} m",
                                 data_.start_u, *data_.end_u, data_.increment));
  }
  return static_cast<std::size_t>(std::llround(steps)) + 1;
}

void Reader::take_record(const std::vector<double>& values) {
  const bool first = data_.heights.empty();
  for (std::size_t i = 0; i < channels_.size(); ++i) {
    std::vector<double>* line = nullptr;
    if (channels_[i].kind == Channel::Kind::kPhi) line = &data_.phi;
    if (channels_[i].kind == Channel::Kind::kSlope) line = &data_.slope;
    if (channels_[i].kind == Channel::Kind::kBanking) line = &data_.banking;
    if (line == nullptr) continue;
    const bool used = !first || line == &data_.banking;
    if (used && !std::isfinite(values[i]) && line != &data_.banking) {
      throw InputError(path_.string(), fmt::format("cross section {}", data_.sections() + 1),
                       "the reference line is unknown, expected a number");
    }
    line->push_back(std::isfinite(values[i]) ? values[i] : 0.0);
  }
  for (const std::size_t i : order_) data_.heights.push_back(static_cast<float>(values[i]));
}

double Reader::cell(std::string_view text) const {
  text = trimmed(text);
  if (!text.empty() && text.front() == '*') return kNaN;
  std::string number(text);
  for (char& c : number) {
    if (c == 'd' || c == 'D') c = 'e';
  }
  const ParsedNumber parsed = parse_number(number.data(), number.data() + number.size());
  if (number.empty() || parsed.end != number.data() + number.size() ||
      !std::isfinite(parsed.value)) {
    lines_.fail(fmt::format("found {}, expected a number or *missing*", shown(text)));
  }
  return parsed.value;
}

void Reader::read_text_records(std::size_t expected) {
  const detail::CrgLayout layout = detail::crg_layout(data_.encoding);
  const auto width = static_cast<std::size_t>(layout.width);
  const auto per_line = static_cast<std::size_t>(layout.per_line);
  std::vector<double> values;
  std::string_view line;
  while (lines_.next(line, kHeaderLine)) {
    const std::string_view shown_line = trimmed(line);
    if (shown_line.empty()) continue;
    const std::size_t here = std::min(per_line, channels_.size() - values.size());
    for (std::size_t i = 0; i < here; ++i) {
      if (line.size() <= i * width || trimmed(line.substr(i * width)).empty()) {
        lines_.fail(fmt::format("found {} numbers, expected {}", i, here));
      }
      values.push_back(cell(line.substr(i * width, width)));
    }
    if (!trimmed(line.substr(std::min(here * width, line.size()))).empty()) {
      lines_.fail(fmt::format("found more than {} characters, expected {} numbers of {}",
                              here * width, here, width));
    }
    if (values.size() < channels_.size()) continue;
    take_record(values);
    values.clear();
    if (expected > 0 && data_.sections() > expected) {
      lines_.fail(fmt::format("found more than the {} cross sections of the header", expected));
    }
  }
  if (!values.empty()) {
    lines_.fail(fmt::format("the file ends within a cross section: found {} numbers of {}",
                            values.size(), channels_.size()));
  }
}

void Reader::read_binary_records(std::size_t expected) {
  lines_.release();
  const auto width = static_cast<std::size_t>(detail::crg_layout(data_.encoding).width);
  const std::size_t record = width * channels_.size();
  if (expected == 0) {
    throw InputError(path_.string(), "header",
                     "no REFERENCE_LINE_END_U, which binary records need");
  }
  if (file_.remaining() / record < expected) {
    file_.fail_at(file_.position(),
                  fmt::format("found {} bytes, expected {} for {} cross sections of {} channels",
                              file_.remaining(), expected * record, expected, channels_.size()));
  }
  data_.heights.reserve(expected * data_.v.size());
  std::vector<double> values(channels_.size());
  for (std::size_t row = 0; row < expected; ++row) {
    if (!file_.fill(record)) file_.fail_at(file_.position(), "the file ends within its records");
    for (std::size_t i = 0; i < values.size(); ++i) {
      const unsigned char* const bytes = file_.data() + i * width;
      std::uint64_t bits = 0;
      for (std::size_t b = 0; b < width; ++b) bits = bits << 8 | bytes[b];
      if (width == 4) {
        const auto half = static_cast<std::uint32_t>(bits);
        float value = 0.0f;
        std::memcpy(&value, &half, sizeof value);
        values[i] = value;
      } else {
        std::memcpy(&values[i], &bits, sizeof bits);
      }
      if (std::isinf(values[i])) values[i] = kNaN;
    }
    file_.consume(record);
    take_record(values);
  }
}

void Reader::read_records() {
  finish_header();
  const std::size_t expected = announced_sections();
  if (detail::crg_layout(data_.encoding).text) {
    read_text_records(expected);
  } else {
    read_binary_records(expected);
  }
  const std::size_t found = data_.sections();
  if (expected > 0 && found != expected) {
    throw InputError(
        path_.string(), "records",
        fmt::format("found {} cross sections, expected the {} of the header", found, expected));
  }
  if (found < 2) {
    throw InputError(path_.string(), "records",
                     fmt::format("found {} cross sections, expected at least 2", found));
  }
}

void Reader::read() {
  data_.files.push_back(path_);
  std::string_view line;
  bool any = false;
  while (!in_records_ && lines_.next(line, kHeaderLine)) {
    if (!any && !trimmed(line).empty()) {
      any = true;
      if (line.front() != '$' && line.front() != '*') {
        lines_.fail(
            fmt::format("found {}, expected a block of an OpenCRG file such as $CT", shown(line)));
      }
    }
    header_line(line);
  }
  if (in_records_) return read_records();
  finish_block();
  if (data_.v.empty()) {
    throw InputError(path_.string(),
                     "found no records, expected a line of $$$$ and behind it "
                     "numbers, or $ROAD_CRG_FILE");
  }
}

}  // namespace

CrgData read_crg(const fs::path& path, const fs::path& folder) {
  CrgData data;
  Reader(path, folder, &data, 0).read();
  return data;
}

}  // namespace camber
