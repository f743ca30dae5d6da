#include "camber/cloud/coordinate_system.h"

#include <algorithm>
#include <cctype>
#include <cmath>
#include <cstring>

#include "camber/cloud/number_text.h"
#include "camber/core/lower_case.h"

namespace camber {
namespace {

constexpr double kInternationalFoot = 0.3048;
constexpr double kUsSurveyFoot = 1200.0 / 3937.0;

struct KnownUnit {
  int code;  // EPSG
  const char* name;
  double metres;
  bool angle;
  const char* spellings;  // between blanks; letters and digits of the name in lower case
};

/// EPSG's units of measure that coordinate systems are in.
constexpr KnownUnit kUnits[] = {
    {9001, "metre", 1.0, false, " metre meter metres meters m "},
    {9002, "foot", kInternationalFoot, false,
     " foot feet ft internationalfoot footinternational intlfoot "},
    {9003, "US survey foot", kUsSurveyFoot, false,
     " ussurveyfoot ussurveyfeet footus usfoot usfeet usft ftus surveyfoot foot_us footussurvey "},
    {9005, "Clarke's foot", 0.3047972654, false, " clarkesfoot footclarke "},
    {9030, "nautical mile", 1852.0, false, " nauticalmile "},
    {9036, "kilometre", 1000.0, false, " kilometre kilometer km "},
    {9037, "Clarke's yard", 0.9143917962, false, " clarkesyard yardclarke "},
    {9040, "British yard (Sears 1922)", 0.9143984146160287, false,
     " britishyardsears1922 yardsears "},
    {9041, "British foot (Sears 1922)", 0.3047994715386762, false,
     " britishfootsears1922 footsears "},
    {9080, "Indian foot", 0.30479951024814694, false, " indianfoot footindian "},
    {9084, "Indian yard", 0.9143985307444408, false, " indianyard yardindian "},
    {9093, "Statute mile", 1609.344, false, " statutemile mile "},
    {9094, "Gold Coast foot", 0.3047997101815088, false, " goldcoastfoot footgoldcoast "},
    {9096, "yard", 0.9144, false, " yard "},
    {9101, "radian", 1.0, true, " radian radians rad "},
    {9102, "degree", 1.0, true, " degree degrees deg decimaldegree "},
    {9105, "grad", 1.0, true, " grad gon "},
    {1025, "millimetre", 1e-3, false, " millimetre millimeter mm "},
    {1033, "centimetre", 1e-2, false, " centimetre centimeter cm "},
};

CoordinateUnit make_unit(const KnownUnit& known) {
  CoordinateUnit unit;
  unit.name = known.name;
  unit.metres = known.metres;
  unit.angle = known.angle;
  unit.epsg = known.code;
  return unit;
}

// --- well-known text ---------------------------------------------------------------------------

/// KEYWORD["text", number, KEYWORD[...], ...]
struct WktNode {
  std::string keyword;              // in capitals
  std::vector<std::string> values;  // quoted text, numbers and bare words in their order
  std::vector<WktNode> children;
};

class WktParser {
 public:
  explicit WktParser(std::string_view text) : text_(text) {}

  bool parse(WktNode& node) { return parse_node(node, 0); }

 private:
  static constexpr int kDeepest = 32;

  void skip() {
    while (at_ < text_.size() && std::isspace(static_cast<unsigned char>(text_[at_]))) ++at_;
  }
  bool parse_node(WktNode& node, int depth) {
    if (depth > kDeepest) return false;
    skip();
    while (at_ < text_.size() &&
           (std::isalnum(static_cast<unsigned char>(text_[at_])) || text_[at_] == '_')) {
      node.keyword += static_cast<char>(std::toupper(static_cast<unsigned char>(text_[at_++])));
    }
    skip();
    if (node.keyword.empty() || at_ >= text_.size() || (text_[at_] != '[' && text_[at_] != '(')) {
      return false;
    }
    ++at_;
    while (true) {
      skip();
      if (at_ >= text_.size()) return false;
      if (!parse_item(node, depth)) return false;
      skip();
      if (at_ >= text_.size()) return false;
      const char c = text_[at_++];
      if (c == ']' || c == ')') return true;
      if (c != ',') return false;
    }
  }
  bool parse_item(WktNode& node, int depth) {
    if (text_[at_] == '"') {
      std::string value;
      for (++at_; at_ < text_.size(); ++at_) {
        if (text_[at_] == '"') {
          if (at_ + 1 < text_.size() && text_[at_ + 1] == '"')
            ++at_;  // a quote within
          else
            break;
        }
        value += text_[at_];
      }
      if (at_ >= text_.size()) return false;
      ++at_;
      node.values.push_back(std::move(value));
      return true;
    }
    // A keyword with brackets, or a number or word.
    const std::size_t start = at_;
    std::size_t end = at_;
    while (end < text_.size() && std::strchr("[](),\"", text_[end]) == nullptr) ++end;
    if (end < text_.size() && (text_[end] == '[' || text_[end] == '(')) {
      node.children.emplace_back();
      return parse_node(node.children.back(), depth + 1);
    }
    at_ = end;
    std::string_view value = text_.substr(start, end - start);
    while (!value.empty() && std::isspace(static_cast<unsigned char>(value.back()))) {
      value.remove_suffix(1);
    }
    node.values.emplace_back(value);
    return true;
  }

  std::string_view text_;
  std::size_t at_ = 0;
};

bool is_any(const std::string& keyword, std::initializer_list<const char*> names) {
  return std::any_of(names.begin(), names.end(), [&](const char* n) { return keyword == n; });
}

const WktNode* find_child(const WktNode& node, std::initializer_list<const char*> names) {
  for (const WktNode& child : node.children) {
    if (is_any(child.keyword, names)) return &child;
  }
  return nullptr;
}

int whole_number(const std::string& text) {
  std::uint64_t value = 0;
  return parse_unsigned(text, value) && value < 1000000 ? static_cast<int>(value) : 0;
}

/// AUTHORITY["EPSG","26917"] or ID["EPSG",26917]
int find_epsg(const WktNode& node) {
  const WktNode* id = find_child(node, {"AUTHORITY", "ID"});
  const bool good = id && id->values.size() >= 2 && lower_case(id->values[0]) == "epsg";
  return good ? whole_number(id->values[1]) : 0;
}

CoordinateUnit unit_of(const WktNode& node) {
  const WktNode* unit = find_child(node, {"UNIT", "LENGTHUNIT", "ANGLEUNIT"});
  if (!unit) {
    const WktNode* axis = find_child(node, {"AXIS"});
    if (axis) unit = find_child(*axis, {"UNIT", "LENGTHUNIT", "ANGLEUNIT"});
  }
  if (!unit || unit->values.empty()) return {};
  // A known name goes before the factor: UNIT["US survey foot",1.0] stands in files.
  CoordinateUnit found = unit_from_name(unit->values[0]);
  if (found.known()) return found;
  found = unit_from_epsg(find_epsg(*unit));
  if (found.known() || unit->values.size() < 2) return found;
  const std::string& factor = unit->values[1];
  const ParsedNumber number = parse_number(factor.data(), factor.data() + factor.size());
  if (number.end == nullptr || !std::isfinite(number.value) || !(number.value > 0.0)) return found;
  found.name = unit->values[0];
  found.angle = unit->keyword == "ANGLEUNIT";
  found.metres = found.angle ? 1.0 : number.value;
  return found;
}

void take_vertical(const WktNode& node, CoordinateSystem& out) {
  const CoordinateUnit unit = unit_of(node);
  out.vertical_epsg = find_epsg(node);
  if (!unit.known()) return;
  out.vertical = unit;
  out.vertical_stated = true;
}

void take_system(const WktNode& node, CoordinateSystem& out) {
  using Kind = CoordinateSystem::Kind;
  const std::string& k = node.keyword;
  if (is_any(k, {"COMPD_CS", "COMPOUNDCRS"})) {
    for (const WktNode& child : node.children) take_system(child, out);
  } else if (is_any(k, {"BOUNDCRS"})) {
    const WktNode* source = find_child(node, {"SOURCECRS"});
    if (source && !source->children.empty()) take_system(source->children[0], out);
  } else if (is_any(k, {"VERT_CS", "VERTCS", "VERTCRS", "VERTICALCRS"})) {
    take_vertical(node, out);
  } else if (out.kind == Kind::kUnknown) {
    if (is_any(k, {"PROJCS", "PROJCRS", "PROJECTEDCRS"})) out.kind = Kind::kProjected;
    if (is_any(k, {"GEOGCS", "GEOGCRS", "GEOGRAPHICCRS"})) out.kind = Kind::kGeographic;
    if (is_any(k, {"GEOCCS"})) out.kind = Kind::kGeocentric;
    if (is_any(k, {"GEODCRS", "GEODETICCRS"})) {
      const WktNode* axes = find_child(node, {"CS"});
      const bool cartesian =
          axes && !axes->values.empty() && lower_case(axes->values[0]) == "cartesian";
      out.kind = cartesian ? Kind::kGeocentric : Kind::kGeographic;
    }
    if (is_any(k, {"LOCAL_CS", "ENGCRS", "ENGINEERINGCRS"})) out.kind = Kind::kLocal;
    if (out.kind == Kind::kUnknown) return;
    if (!node.values.empty() && out.name.empty() && node.values[0] != "unknown") {
      out.name = node.values[0];
    }
    out.epsg = find_epsg(node);
    out.horizontal = unit_of(node);
    // Some programs put the vertical system inside of the projected one.
    const WktNode* vertical = find_child(node, {"VERT_CS", "VERTCS", "VERTCRS"});
    if (vertical) take_vertical(*vertical, out);
  }
}

/// What stands for the heights where nothing does.
void complete(CoordinateSystem& system) {
  if (system.kind == CoordinateSystem::Kind::kGeographic && !system.horizontal.known()) {
    system.horizontal = unit_from_epsg(9102);
  }
  if (system.vertical_stated) return;
  system.vertical = system.horizontal.angle ? unit_from_epsg(9001) : system.horizontal;
}

// --- codes -------------------------------------------------------------------------------------

struct KnownSystem {
  int code;  // EPSG
  const char* name;
};

/// Systems of longitude and latitude in degrees, in two and three dimensions. Their numbers lie
/// among those of projected systems.
constexpr KnownSystem kGeographicSystems[] = {
    {4148, "Hartebeesthoek94"},
    {4167, "NZGD2000"},
    {4171, "RGF93 v1"},
    {4258, "ETRS89"},
    {4267, "NAD27"},
    {4269, "NAD83"},
    {4277, "OSGB36"},
    {4283, "GDA94"},
    {4284, "Pulkovo 1942"},
    {4314, "DHDN"},
    {4322, "WGS 72"},
    {4326, "WGS 84"},
    {4480, "China Geodetic Coordinate System 2000"},
    {4490, "China Geodetic Coordinate System 2000"},
    {4612, "JGD2000"},
    {4617, "NAD83(CSRS)"},
    {4674, "SIRGAS 2000"},
    {4737, "Korea 2000"},
    {4937, "ETRS89"},
    {4939, "GDA94"},
    {4947, "JGD2000"},
    {4955, "NAD83(CSRS)"},
    {4957, "NAD83(HARN)"},
    {4959, "NZGD2000"},
    {4965, "RGF93 v1"},
    {4979, "WGS 84"},
    {4985, "WGS 72"},
    {4989, "SIRGAS 2000"},
    {6318, "NAD83(2011)"},
    {6319, "NAD83(2011)"},
    {6667, "JGD2011"},
    {6668, "JGD2011"},
    {7843, "GDA2020"},
    {7844, "GDA2020"},
    {9057, "WGS 84 (G1762)"},
    {9754, "WGS 84 (G2139)"},
    {9755, "WGS 84 (G2139)"},
};

// --- GeoTIFF keys ------------------------------------------------------------------------------

enum GeoKey {
  kModelType = 1024,
  kCitation = 1026,
  kGeographicType = 2048,
  kGeogCitation = 2049,
  kGeogAngularUnits = 2054,
  kProjectedType = 3072,
  kProjectedCitation = 3073,
  kProjLinearUnits = 3076,
  kProjLinearUnitSize = 3077,
  kVerticalType = 4096,
  kVerticalUnits = 4099
};

int short_key(const std::map<int, GeoKeyValue>& keys, int key) {
  const auto found = keys.find(key);
  if (found == keys.end()) return 0;
  const int* value = std::get_if<int>(&found->second);
  return value ? *value : 0;
}

std::string text_key(const std::map<int, GeoKeyValue>& keys, int key) {
  const auto found = keys.find(key);
  if (found == keys.end()) return {};
  const std::string* value = std::get_if<std::string>(&found->second);
  return value ? *value : std::string();
}

constexpr int kUserDefined = 32767;

int code_key(const std::map<int, GeoKeyValue>& keys, int key) {
  const int code = short_key(keys, key);
  return code == kUserDefined ? 0 : code;
}

std::uint16_t short_at(std::string_view bytes, std::size_t at) {
  std::uint16_t value;
  std::memcpy(&value, bytes.data() + at, 2);
  return value;
}

}  // namespace

const char* to_string(CoordinateSystem::Kind kind) {
  switch (kind) {
    case CoordinateSystem::Kind::kProjected:
      return "projected";
    case CoordinateSystem::Kind::kGeographic:
      return "geographic";
    case CoordinateSystem::Kind::kGeocentric:
      return "geocentric";
    case CoordinateSystem::Kind::kLocal:
      return "local";
    case CoordinateSystem::Kind::kUnknown:
      break;
  }
  return "unknown";
}

CoordinateUnit unit_from_epsg(int code) {
  for (const KnownUnit& known : kUnits) {
    if (known.code == code) return make_unit(known);
  }
  return {};
}

CoordinateUnit unit_from_metres(double metres) {
  for (const KnownUnit& known : kUnits) {
    if (!known.angle && known.metres == metres) return make_unit(known);
  }
  CoordinateUnit unit;
  unit.name = "unit of ";
  append_number(unit.name, metres);
  unit.name += " m";
  unit.metres = metres;
  return unit;
}

CoordinateUnit unit_from_name(std::string_view name) {
  std::string key = " ";
  for (const char c : lower_case(name)) {
    if (std::isalnum(static_cast<unsigned char>(c))) key += c;
  }
  key += ' ';
  if (key.size() == 2) return {};
  for (const KnownUnit& known : kUnits) {
    if (std::string_view(known.spellings).find(key) != std::string_view::npos) {
      return make_unit(known);
    }
  }
  return {};
}

CoordinateSystem coordinate_system_from_epsg(int code) {
  using Kind = CoordinateSystem::Kind;
  CoordinateSystem out;
  out.epsg = code;
  const bool north = code > 32600 && code <= 32660, south = code > 32700 && code <= 32760;
  if (north || south) {
    out.kind = Kind::kProjected;
    out.name = "WGS 84 / UTM zone " + std::to_string(code % 100) + (north ? "N" : "S");
    out.horizontal = unit_from_epsg(9001);
  }
  for (const KnownSystem& known : kGeographicSystems) {
    if (known.code != code) continue;
    out.kind = Kind::kGeographic;
    out.name = known.name;
  }
  complete(out);
  return out;
}

CoordinateSystem coordinate_system_from_wkt(std::string_view wkt) {
  while (!wkt.empty() &&
         (wkt.back() == '\0' || std::isspace(static_cast<unsigned char>(wkt.back())))) {
    wkt.remove_suffix(1);
  }
  while (!wkt.empty() && std::isspace(static_cast<unsigned char>(wkt.front())))
    wkt.remove_prefix(1);
  CoordinateSystem out;
  out.wkt = std::string(wkt);
  WktNode root;
  if (!WktParser(wkt).parse(root)) return out;
  if (is_any(root.keyword, {"COMPD_CS", "COMPOUNDCRS"}) && !root.values.empty()) {
    out.name = root.values[0];
  }
  take_system(root, out);
  complete(out);
  return out;
}

CoordinateSystem coordinate_system_from_geotiff(std::map<int, GeoKeyValue> keys) {
  using Kind = CoordinateSystem::Kind;
  CoordinateSystem out;
  int model = short_key(keys, kModelType);
  const int code = code_key(keys, model == 2 ? kGeographicType : kProjectedType);
  const CoordinateSystem by_code = coordinate_system_from_epsg(code);
  const Kind kind = by_code.kind;
  if ((model == 0 || model == 1) && kind == Kind::kGeographic) model = 2;
  const bool projected = model == 1 || (model == 0 && keys.count(kProjectedType) > 0);
  const bool geographic =
      model == 2 || (model == 0 && !projected && keys.count(kGeographicType) > 0);
  if (projected) {
    out.kind = Kind::kProjected;
    out.epsg = code_key(keys, kProjectedType);
    out.name = text_key(keys, kProjectedCitation);
    out.horizontal = unit_from_epsg(code_key(keys, kProjLinearUnits));
    if (!out.horizontal.known()) {
      const auto size = keys.find(kProjLinearUnitSize);
      const auto* metres =
          size == keys.end() ? nullptr : std::get_if<std::vector<double>>(&size->second);
      if (metres && metres->size() == 1 && std::isfinite((*metres)[0]) && (*metres)[0] > 0.0) {
        out.horizontal = unit_from_metres((*metres)[0]);
      }
    }
    if (!out.horizontal.known()) {
      out.horizontal = coordinate_system_from_epsg(out.epsg).horizontal;
    }
  } else if (geographic) {
    out.kind = Kind::kGeographic;
    out.epsg = kind == Kind::kGeographic ? code : code_key(keys, kGeographicType);
    out.name = text_key(keys, kGeogCitation);
    out.horizontal = unit_from_epsg(code_key(keys, kGeogAngularUnits));
  } else if (model == 3) {
    out.kind = Kind::kGeocentric;
    out.epsg = code_key(keys, kGeographicType);
    out.horizontal = unit_from_epsg(9001);
  }
  const std::string citation = text_key(keys, kCitation);
  if (out.name.empty() && citation != "unknown") out.name = citation;
  if (out.name.empty() && geographic) out.name = by_code.name;
  out.vertical_epsg = code_key(keys, kVerticalType);
  out.vertical = unit_from_epsg(code_key(keys, kVerticalUnits));
  out.vertical_stated = out.vertical.known();
  complete(out);
  out.geotiff_keys = std::move(keys);
  return out;
}

std::map<int, GeoKeyValue> read_geotiff_keys(std::string_view directory, std::string_view doubles,
                                             std::string_view text) {
  constexpr int kDoubles = 34736, kText = 34737;
  // Keys may share what they point at: so many bytes of values at most, whatever they claim.
  constexpr std::size_t kMostBytes = 1 << 20;
  std::size_t taken = 0;
  std::map<int, GeoKeyValue> keys;
  if (directory.size() < 8) return keys;
  const std::size_t entries =
      std::min<std::size_t>(short_at(directory, 6), directory.size() / 8 - 1);
  for (std::size_t e = 1; e <= entries; ++e) {
    const int key = short_at(directory, 8 * e), place = short_at(directory, 8 * e + 2);
    const std::size_t count = short_at(directory, 8 * e + 4);
    const std::size_t value = short_at(directory, 8 * e + 6);
    taken += place == kDoubles ? 8 * count : place == kText ? count : 0;
    if (taken > kMostBytes) break;
    if (place == 0) {
      // Zero entries are padding that some programs leave.
      if (key != 0) keys[key] = static_cast<int>(value);
    } else if (place == kDoubles && value + count <= doubles.size() / 8) {
      std::vector<double> numbers(count);
      if (count > 0) std::memcpy(numbers.data(), doubles.data() + 8 * value, 8 * count);
      keys[key] = std::move(numbers);
    } else if (place == kText && value + count <= text.size()) {
      std::string_view part = text.substr(value, count);
      while (!part.empty() && (part.back() == '|' || part.back() == '\0')) part.remove_suffix(1);
      keys[key] = std::string(part);
    }
  }
  return keys;
}

std::string geotiff_key_name(int key) {
  static const std::map<int, const char*> kNames = {
      {1024, "GTModelType"},      {1025, "GTRasterType"},     {1026, "GTCitation"},
      {2048, "GeographicType"},   {2049, "GeogCitation"},     {2050, "GeogGeodeticDatum"},
      {2052, "GeogLinearUnits"},  {2054, "GeogAngularUnits"}, {2056, "GeogEllipsoid"},
      {3072, "ProjectedCSType"},  {3073, "PCSCitation"},      {3074, "Projection"},
      {3075, "ProjCoordTrans"},   {3076, "ProjLinearUnits"},  {4096, "VerticalCSType"},
      {4097, "VerticalCitation"}, {4098, "VerticalDatum"},    {4099, "VerticalUnits"}};
  const auto found = kNames.find(key);
  return found == kNames.end() ? std::to_string(key) : found->second;
}

void complete_system(CoordinateSystem* system, const FindSystem& find) {
  const bool complete =
      system->horizontal.known() && system->kind != CoordinateSystem::Kind::kUnknown;
  if (complete || system->epsg == 0) return;
  CoordinateSystem found;
  std::string reason;
  if (!find("EPSG:" + std::to_string(system->epsg), &found, &reason)) return;
  // Of a code alone, files also state a wrong kind.
  if (!system->horizontal.known()) system->kind = found.kind;
  if (!system->horizontal.known()) system->horizontal = found.horizontal;
  if (system->kind == CoordinateSystem::Kind::kUnknown) system->kind = found.kind;
  if (system->name.empty()) system->name = found.name;
  if (!system->vertical_stated) system->vertical = found.vertical;
}

bool system_of_definition(const std::string& definition, const FindSystem& find,
                          CoordinateSystem* system, std::string* reason) {
  *system = coordinate_system_from_wkt(definition);
  if (system->kind == CoordinateSystem::Kind::kUnknown && !find(definition, system, reason)) {
    return false;
  }
  system->given = true;
  return true;
}

std::string definition_of(const CoordinateSystem& system) {
  return system.epsg != 0 ? "EPSG:" + std::to_string(system.epsg) : system.wkt;
}

std::string definition_for_raster(const CoordinateSystem& system) {
  if (system.epsg != 0 && system.vertical_epsg != 0) {
    return "EPSG:" + std::to_string(system.epsg) + "+" + std::to_string(system.vertical_epsg);
  }
  return system.vertical_stated && !system.wkt.empty() ? system.wkt : definition_of(system);
}

std::string height_unit_of(const CoordinateSystem& system) {
  const bool other = system.vertical.known() && !system.vertical.metre();
  return other ? system.vertical.name : "m";
}

std::string describe(const CoordinateSystem& system) {
  std::string out = system.name.empty() ? std::string(to_string(system.kind)) : system.name;
  for (char& c : out) {
    if (static_cast<unsigned char>(c) < 0x20 || c == 0x7f) c = '?';  // names come from files
  }
  if (system.epsg > 0) out += ", EPSG:" + std::to_string(system.epsg);
  if (system.vertical_epsg > 0) out += " + EPSG:" + std::to_string(system.vertical_epsg);
  if (system.horizontal.known()) {
    out += ", " + system.horizontal.name;
    if (system.vertical.known() && system.vertical.name != system.horizontal.name) {
      out += ", heights in " + system.vertical.name;
    }
  }
  return out;
}

}  // namespace camber
