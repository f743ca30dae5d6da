#include "camber/import/formats/class_map.h"

#include <fmt/format.h>

#include <algorithm>
#include <map>
#include <set>

#include "camber/core/errors.h"
#include "camber/core/lower_case.h"
#include "camber/core/read_file.h"
#include "camber/import/formats/detail/delimited_lines.h"
#include "camber/import/formats/detail/document.h"
#include "camber/import/import_common.h"

namespace fs = std::filesystem;

namespace camber {
namespace {

constexpr int kMaxId = 1 << 24;

ClassMap read_csv(const fs::path& path, char separator) {
  const DelimitedLines lines(path, separator);
  ClassMap out;
  if (lines.lines().empty())
    throw InputError(path.string(), "found no class, expected a table of classes");
  std::map<std::string, std::size_t> columns;
  const DelimitedLine& header = lines.lines().front();
  for (std::size_t i = 0; i < header.fields.size(); ++i)
    columns.emplace(plain_name(std::string(header.fields[i])), i);
  const auto column = [&](std::initializer_list<const char*> names) -> std::optional<std::size_t> {
    for (const char* name : names) {
      if (const auto at = columns.find(name); at != columns.end()) return at->second;
    }
    return std::nullopt;
  };
  const auto name = column({"name", "class", "label", "classname"}),
             id = column({"id", "labelid", "value", "index"});
  const auto train = column({"trainid"}), category = column({"category"});
  const auto red = column({"red", "r"}), green = column({"green", "g"}),
             blue = column({"blue", "b"});
  const bool colors = red && green && blue;
  if (!name || (!id && !colors)) {
    lines.fail(header,
               "found no column name beside id or red, green, blue, expected a table of classes");
  }
  for (std::size_t i = 1; i < lines.lines().size(); ++i) {
    const DelimitedLine& line = lines.lines()[i];
    MaskClass one;
    if (*name >= line.fields.size())
      lines.fail(line, fmt::format("found {} fields, expected a name", line.fields.size()));
    one.name = std::string(line.fields[*name]);
    const char* expectation = "a whole number from -1";
    if (id) one.id = lines.integer(line, *id, -1, kMaxId, expectation);
    if (train) one.train_id = lines.integer(line, *train, -1, kMaxId, expectation);
    if (category && *category < line.fields.size())
      one.category = std::string(line.fields[*category]);
    if (colors) {
      const char* channel = "a whole number from 0 to 255";
      one.color = {{lines.integer(line, *red, 0, 255, channel),
                    lines.integer(line, *green, 0, 255, channel),
                    lines.integer(line, *blue, 0, 255, channel)}};
    }
    out.classes.push_back(std::move(one));
  }
  return out;
}

/// label:r,g,b:parts:actions
ClassMap read_label_map(const fs::path& path) {
  const DelimitedLines lines(path, ':');
  ClassMap out;
  for (const DelimitedLine& line : lines.lines()) {
    MaskClass one;
    one.name = std::string(line.fields[0]);
    if (line.fields.size() < 2) lines.fail(line, "found no colour, expected label:red,green,blue");
    const std::string color(line.fields[1]);
    if (!color.empty()) {
      std::array<int, 3> rgb{};
      int count = 0;
      if (std::sscanf(color.c_str(), "%d,%d,%d%n", &rgb[0], &rgb[1], &rgb[2], &count) != 3 ||
          count != static_cast<int>(color.size()) ||
          std::any_of(rgb.begin(), rgb.end(), [](int v) { return v < 0 || v > 255; })) {
        lines.fail(
            line, 1,
            fmt::format("found '{}', expected red,green,blue from 0 to 255", printable(color)));
      }
      one.color = rgb;
    }
    out.classes.push_back(std::move(one));
  }
  return out;
}

ClassMap read_document(const fs::path& path) {
  const Document document = Document::read(path);
  ClassMap out;
  const YAML::Node& root = document.root();
  if (!root.IsMap()) document.expected(root, "classes by name or number");
  const auto labels = find_by_plain_name(root, {"labels", "classes", "names"});
  const auto colors = find_by_plain_name(root, {"colormap"});
  const auto learning = find_by_plain_name(root, {"learningmap"});
  const YAML::Node table = labels.value_or(root);
  int next = 0;
  const auto add = [&](int id, const std::string& name) {
    MaskClass one;
    one.id = id;
    one.name = name;
    out.classes.push_back(std::move(one));
  };
  if (table.IsSequence()) {
    for (const YAML::Node& name : table) add(next++, text_of(name));
  } else {
    for (const auto& entry : table) {
      const std::string key = text_of(entry.first);
      const bool number = !key.empty() && key.find_first_not_of("0123456789") == std::string::npos;
      if (number) {
        add(document.integer(entry.first, 0, kMaxId, "a class number"), text_of(entry.second));
      } else {
        add(document.integer(entry.second, 0, kMaxId, "a class number"), key);
      }
    }
  }
  const auto look = [&](const YAML::Node& map, int id) -> std::optional<YAML::Node> {
    for (const auto& entry : map) {
      if (text_of(entry.first) == std::to_string(id)) return entry.second;
    }
    return std::nullopt;
  };
  for (MaskClass& one : out.classes) {
    if (colors && colors->IsMap()) {
      if (const auto bgr = look(*colors, *one.id)) {
        const std::vector<double> v = document.numbers(*bgr, "blue, green, red");
        const bool color = v.size() == 3 && std::all_of(v.begin(), v.end(), [](double c) {
                             return c >= 0.0 && c <= 255.0;
                           });
        if (!color) document.expected(*bgr, "blue, green, red, each from 0 to 255");
        one.color = {{static_cast<int>(v[2]), static_cast<int>(v[1]), static_cast<int>(v[0])}};
      }
    }
    if (learning && learning->IsMap()) {
      if (const auto id = look(*learning, *one.id))
        one.train_id = document.integer(*id, -1, kMaxId, "a class number");
    }
  }
  return out;
}

ClassMap of_ids(std::initializer_list<std::pair<int, const char*>> ids) {
  ClassMap out;
  for (const auto& [id, name] : ids) {
    MaskClass one;
    one.id = id;
    one.name = name;
    out.classes.push_back(std::move(one));
  }
  return out;
}

MaskClass colored(const char* name, int red, int green, int blue) {
  MaskClass out;
  out.name = name;
  out.color = {{red, green, blue}};
  return out;
}

/// "construction--flat--road" is "road"; blanks and hyphens are one.
std::string last_part(const std::string& name) {
  std::string out = lower_case(name);
  const std::size_t mark = out.rfind("--");
  if (mark != std::string::npos) out = out.substr(mark + 2);
  std::replace(out.begin(), out.end(), '-', ' ');
  std::replace(out.begin(), out.end(), '_', ' ');
  return out;
}

}  // namespace

bool ClassMap::has_colors() const {
  return std::all_of(classes.begin(), classes.end(),
                     [](const MaskClass& c) { return c.color.has_value(); });
}

bool ClassMap::has_ids() const {
  return std::all_of(classes.begin(), classes.end(),
                     [](const MaskClass& c) { return c.id.has_value(); });
}

ClassMap read_class_map(const fs::path& path) {
  const std::string extension = lower_case(path.extension().string());
  if (extension == ".yaml" || extension == ".yml" || extension == ".json")
    return read_document(path);
  const std::string text = read_whole_file(path, std::size_t{16} << 20);
  const char separator = separator_of(text);
  const DelimitedLines colons(path, ':');
  ClassMap out;
  if (!colons.lines().empty() && colons.lines().front().fields.size() >= 2) {
    out = read_label_map(path);
  } else if (separator == ' ') {
    const DelimitedLines lines(path, '\n');
    for (const DelimitedLine& line : lines.lines()) {
      MaskClass one;
      one.id = static_cast<int>(out.classes.size());
      one.name = std::string(line.fields[0]);
      out.classes.push_back(std::move(one));
    }
  } else {
    out = read_csv(path, separator);
  }
  if (out.classes.empty())
    throw InputError(path.string(), "found no class, expected a table of classes");
  return out;
}

std::vector<std::string> class_map_names() {
  return {"kitti-road",       "cityscapes", "cityscapes-train", "bdd100k",
          "bdd100k-drivable", "mapillary",  "mapillary-2",      "camber"};
}

std::optional<ClassMap> named_class_map(const std::string& name) {
  // Numbers of the data sets' own documentation.
  if (name ==
      "kitti-road") {  // pictures of the ground truth: red alone is not road, black not valued
    ClassMap out;
    out.classes = {colored("road", 255, 0, 255), colored("not road", 255, 0, 0),
                   colored("not evaluated", 0, 0, 0)};
    return out;
  }
  if (name == "cityscapes") {
    return of_ids({{6, "ground"},
                   {7, "road"},
                   {8, "sidewalk"},
                   {9, "parking"},
                   {26, "car"},
                   {27, "truck"},
                   {28, "bus"},
                   {29, "caravan"},
                   {30, "trailer"}});
  }
  if (name == "cityscapes-train" || name == "bdd100k") {
    return of_ids({{0, "road"}, {1, "sidewalk"}, {13, "car"}, {14, "truck"}, {15, "bus"}});
  }
  if (name == "mapillary") {
    return of_ids({{2, "curb"},
                   {7, "bike lane"},
                   {8, "crosswalk plain"},
                   {9, "curb cut"},
                   {10, "parking"},
                   {11, "pedestrian area"},
                   {13, "road"},
                   {14, "service lane"},
                   {15, "sidewalk"},
                   {23, "lane marking crosswalk"},
                   {24, "lane marking general"},
                   {36, "catch basin"},
                   {41, "manhole"},
                   {43, "pothole"},
                   {54, "bus"},
                   {55, "car"},
                   {56, "caravan"},
                   {59, "other vehicle"},
                   {60, "trailer"},
                   {61, "truck"}});
  }
  if (name == "mapillary-2") {
    ClassMap out = of_ids({{13, "bike lane"},
                           {14, "crosswalk plain"},
                           {15, "curb cut"},
                           {16, "driveway"},
                           {17, "parking"},
                           {18, "parking aisle"},
                           {19, "pedestrian area"},
                           {21, "road"},
                           {22, "road shoulder"},
                           {23, "service lane"},
                           {24, "sidewalk"},
                           {69, "catch basin"},
                           {74, "manhole"},
                           {77, "pothole"},
                           {107, "bus"},
                           {108, "car"},
                           {109, "caravan"},
                           {112, "other vehicle"},
                           {113, "trailer"},
                           {114, "truck"}});
    for (int id = 35; id <= 58; ++id) {
      MaskClass marking;
      marking.id = id;
      marking.name = "marking";
      out.classes.push_back(std::move(marking));
    }
    return out;
  }
  if (name == "bdd100k-drivable") return of_ids({{0, "direct"}, {1, "alternative"}});
  if (name == "camber") return of_ids({{1, "road"}, {2, "pavement"}, {3, "vehicle"}});
  return std::nullopt;
}

MaskRole role_of_class(const std::string& name) {
  static const std::set<std::string> road = {"road",
                                             "lane marking",
                                             "road marking",
                                             "roadmarking",
                                             "service lane",
                                             "crosswalk plain",
                                             "crosswalk",
                                             "manhole",
                                             "road shoulder",
                                             "parking aisle",
                                             "drivable",
                                             "drivable area",
                                             "street",
                                             "bike lane",
                                             "lane marking general",
                                             "lane marking crosswalk",
                                             "direct",
                                             "alternative",
                                             "asphalt",
                                             "pothole",
                                             "catch basin"};
  static const std::set<std::string> pavement = {
      "sidewalk", "pavement", "curb cut", "pedestrian area", "parking", "driveway", "footpath"};
  static const std::set<std::string> vehicle = {
      "car",         "truck",        "bus",        "van",
      "vehicle",     "caravan",      "trailer",    "other vehicle",
      "moving car",  "moving truck", "moving bus", "moving other vehicle",
      "moving other"};
  const std::string lower = lower_case(name);
  const std::string part = last_part(name);
  if (lower.rfind("marking", 0) == 0)
    return MaskRole::kRoad;  // all of Mapillary's markings lie on roads
  if (road.count(part)) return MaskRole::kRoad;
  if (pavement.count(part)) return MaskRole::kPavement;
  if (vehicle.count(part)) return MaskRole::kVehicle;
  return MaskRole::kOther;
}

}  // namespace camber
