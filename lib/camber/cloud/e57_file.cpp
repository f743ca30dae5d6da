// Header and XML of E57 files: ASTM E2807-11 as its authors describe it (Huber, "The ASTM E57 file
// format for 3D imaging data exchange", SPIE 7864, 2011); docs/notes/e57.md has the rest.

#include "camber/cloud/e57_file.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <cstring>
#include <pugixml.hpp>

#include "camber/cloud/detail/e57_pages.h"
#include "camber/cloud/number_text.h"
#include "camber/core/errors.h"

namespace camber {
namespace {

constexpr std::size_t kHeaderSize = 48;
constexpr std::size_t kMostFields = 256;  // of a record
constexpr int kMostNested = 8;            // structures in a record

std::uint64_t number64(const std::string& bytes, std::size_t at) {
  std::uint64_t value = 0;
  std::memcpy(&value, bytes.data() + at, sizeof value);
  return value;
}

std::string_view trimmed(std::string_view text) {
  const std::size_t first = text.find_first_not_of(" \t\r\n");
  if (first == std::string_view::npos) return {};
  return text.substr(first, text.find_last_not_of(" \t\r\n") + 1 - first);
}

class XmlReader {
 public:
  XmlReader(const std::string& file, E57File* out) : file_(file), out_(*out) {}

  void read(const pugi::xml_document& document);

 private:
  [[noreturn]] void fail(const std::string& path, const std::string& reason) const {
    throw InputError(file_, path, reason);
  }
  double number(std::string_view text, const std::string& path) const;
  std::int64_t integer(std::string_view text, const std::string& path) const;
  std::uint64_t size(const pugi::xml_node& node, const char* attribute,
                     const std::string& path) const;
  /// The value of an element; one without text is 0.
  double value(const pugi::xml_node& node, const std::string& path) const;
  double child_number(const pugi::xml_node& parent, const char* name,
                      const std::string& path) const;
  /// All numbers among the children of one child.
  void numbers(const pugi::xml_node& parent, const char* name, const std::string& path,
               E57Numbers* out) const;
  std::optional<E57Pose> pose(const pugi::xml_node& parent, const std::string& path) const;
  E57Scan scan(const pugi::xml_node& node, const std::string& path) const;
  void fields(const pugi::xml_node& node, const std::string& path, const std::string& prefix,
              int depth, std::vector<E57Field>* out) const;
  E57Image image(const pugi::xml_node& node, const std::string& path) const;

  const std::string& file_;
  E57File& out_;
};

std::string text_of(const pugi::xml_node& parent, const char* name) {
  return std::string(trimmed(parent.child_value(name)));
}

double XmlReader::number(std::string_view text, const std::string& path) const {
  text = trimmed(text);
  if (text.empty()) return 0.0;
  const ParsedNumber parsed = parse_number(text.data(), text.data() + text.size());
  if (parsed.end != text.data() + text.size()) {
    fail(path, "found " + shown(text) + ", expected a number");
  }
  return parsed.value;
}

std::int64_t XmlReader::integer(std::string_view text, const std::string& path) const {
  text = trimmed(text);
  if (text.empty()) return 0;
  std::int64_t value = 0;
  const char* const first = text.data() + (text[0] == '+' ? 1 : 0);
  const auto [end, error] = std::from_chars(first, text.data() + text.size(), value);
  if (error != std::errc() || end != text.data() + text.size()) {
    fail(path, "found " + shown(text) + ", expected a whole number of 64 bits");
  }
  return value;
}

std::uint64_t XmlReader::size(const pugi::xml_node& node, const char* attribute,
                              const std::string& path) const {
  const std::string_view text = trimmed(node.attribute(attribute).value());
  std::uint64_t value = 0;
  if (!parse_unsigned(text, value)) {
    fail(path + "/@" + attribute, "found " + shown(text) + ", expected a whole number");
  }
  return value;
}

double XmlReader::value(const pugi::xml_node& node, const std::string& path) const {
  const double out = number(node.child_value(), path);
  if (std::string_view(node.attribute("type").value()) != "ScaledInteger") return out;
  const pugi::xml_attribute scale = node.attribute("scale");
  return out * (scale ? number(scale.value(), path + "/@scale") : 1.0) +
         number(node.attribute("offset").value(), path + "/@offset");
}

double XmlReader::child_number(const pugi::xml_node& parent, const char* name,
                               const std::string& path) const {
  const double out = value(parent.child(name), path + "/" + name);
  if (!std::isfinite(out)) fail(path + "/" + name, "found a number that is not finite");
  return out;
}

void XmlReader::numbers(const pugi::xml_node& parent, const char* name, const std::string& path,
                        E57Numbers* out) const {
  for (const pugi::xml_node& child : parent.child(name).children()) {
    const std::string_view type = child.attribute("type").value();
    if (type != "Integer" && type != "ScaledInteger" && type != "Float") continue;
    out->emplace_back(child.name(), value(child, path + "/" + name + "/" + child.name()));
  }
}

std::optional<E57Pose> XmlReader::pose(const pugi::xml_node& parent,
                                       const std::string& path) const {
  const pugi::xml_node node = parent.child("pose");
  if (!node) return {};
  E57Pose out;
  if (const pugi::xml_node rotation = node.child("rotation")) {
    const char* const names[] = {"w", "x", "y", "z"};
    for (std::size_t k = 0; k < 4; ++k) {
      out.rotation[k] = child_number(rotation, names[k], path + "/pose/rotation");
    }
  }
  if (const pugi::xml_node translation = node.child("translation")) {
    const char* const names[] = {"x", "y", "z"};
    for (std::size_t k = 0; k < 3; ++k) {
      out.translation[k] = child_number(translation, names[k], path + "/pose/translation");
    }
  }
  return out;
}

void XmlReader::fields(const pugi::xml_node& node, const std::string& path,
                       const std::string& prefix, int depth, std::vector<E57Field>* out) const {
  if (depth > kMostNested) fail(path, "found structures nested deeper than a record's");
  for (const pugi::xml_node& child : node.children()) {
    if (child.type() != pugi::node_element) continue;
    E57Field field;
    field.name = prefix + child.name();
    const std::string at = path + "/" + child.name();
    const std::string_view type = child.attribute("type").value();
    if (type == "Structure" || type == "Vector") {
      fields(child, at, field.name + "/", depth + 1, out);
      continue;
    }
    if (type == "Integer" || type == "ScaledInteger") {
      field.kind = type == "Integer" ? E57Field::Kind::kInteger : E57Field::Kind::kScaledInteger;
      if (const pugi::xml_attribute given = child.attribute("minimum")) {
        field.minimum = integer(given.value(), at + "/@minimum");
      }
      if (const pugi::xml_attribute given = child.attribute("maximum")) {
        field.maximum = integer(given.value(), at + "/@maximum");
      }
      if (field.minimum > field.maximum) fail(at, "found a minimum above the maximum");
      if (type == "ScaledInteger") {
        if (const pugi::xml_attribute given = child.attribute("scale")) {
          field.scale = number(given.value(), at + "/@scale");
        }
        if (const pugi::xml_attribute given = child.attribute("offset")) {
          field.offset = number(given.value(), at + "/@offset");
        }
        if (!std::isfinite(field.scale) || field.scale == 0.0 || !std::isfinite(field.offset)) {
          fail(at, "found scale and offset of integers that are no numbers, expected finite ones");
        }
      }
    } else if (type == "Float") {
      const std::string_view precision = child.attribute("precision").value();
      if (!precision.empty() && precision != "single" && precision != "double") {
        fail(at + "/@precision", "found " + shown(precision) + ", expected single or double");
      }
      field.kind = precision == "single" ? E57Field::Kind::kFloat32 : E57Field::Kind::kFloat64;
    } else if (type == "String") {
      field.kind = E57Field::Kind::kString;
    } else {
      fail(at + "/@type",
           "found " + shown(type) + ", expected Integer, ScaledInteger, Float or String");
    }
    if (out->size() == kMostFields) {
      fail(path, "found more than " + std::to_string(kMostFields) + " values a point");
    }
    out->push_back(std::move(field));
  }
}

E57Scan XmlReader::scan(const pugi::xml_node& node, const std::string& path) const {
  E57Scan out;
  out.guid = text_of(node, "guid");
  out.name = text_of(node, "name");
  out.description = text_of(node, "description");
  out.sensor_vendor = text_of(node, "sensorVendor");
  out.sensor_model = text_of(node, "sensorModel");
  out.sensor_serial = text_of(node, "sensorSerialNumber");
  out.pose = pose(node, path);
  for (const char* const name : {"cartesianBounds", "sphericalBounds", "indexBounds"}) {
    numbers(node, name, path, &out.bounds);
  }
  numbers(node, "intensityLimits", path, &out.limits);
  numbers(node, "colorLimits", path, &out.limits);
  const pugi::xml_node points = node.child("points");
  if (!points) return out;
  const std::string at = path + "/points";
  if (std::string_view(points.attribute("type").value()) != "CompressedVector") {
    fail(at, "found " + shown(points.attribute("type").value()) + ", expected CompressedVector");
  }
  out.points = size(points, "recordCount", at);
  if (out.points > 0) out.section = size(points, "fileOffset", at);
  for (const pugi::xml_node& codec : points.child("codecs").children()) {
    for (const pugi::xml_node& child : codec.children()) {
      const std::string_view name = child.name();
      if (child.type() == pugi::node_element && name != "inputs" && name != "bitPackCodec") {
        fail(at + "/codecs", "found the codec " + shown(name) + ", expected bitPackCodec");
      }
    }
  }
  fields(points.child("prototype"), at + "/prototype", "", 0, &out.fields);
  return out;
}

E57Image XmlReader::image(const pugi::xml_node& node, const std::string& path) const {
  E57Image out;
  out.guid = text_of(node, "guid");
  out.name = text_of(node, "name");
  out.description = text_of(node, "description");
  out.scan_guid = text_of(node, "associatedData3DGuid");
  out.pose = pose(node, path);
  static const std::pair<const char*, const char*> kKinds[] = {
      {"visualReferenceRepresentation", "visual reference"},
      {"pinholeRepresentation", "pinhole"},
      {"sphericalRepresentation", "spherical"},
      {"cylindricalRepresentation", "cylindrical"}};
  // Of an image with a visual reference beside a projection the latter states more.
  for (const auto& [element, kind] : kKinds) {
    const pugi::xml_node found = node.child(element);
    if (!found) continue;
    out.representation = kind;
    out.numbers.clear();
    numbers(node, element, path, &out.numbers);
    for (const char* const media : {"jpeg", "png"}) {
      const std::string blob = std::string(media) + "Image";
      const pugi::xml_node picture = found.child(blob.c_str());
      if (!picture) continue;
      out.media = media;
      out.length = size(picture, "length", path + "/" + element + "/" + blob);
    }
  }
  return out;
}

void XmlReader::read(const pugi::xml_document& document) {
  const pugi::xml_node root = document.document_element();
  if (std::string_view(root.name()) != "e57Root") {
    fail("XML", "found the element " + shown(root.name()) + ", expected e57Root");
  }
  out_.guid = text_of(root, "guid");
  out_.library = text_of(root, "e57LibraryVersion");
  out_.coordinate_metadata = text_of(root, "coordinateMetadata");
  constexpr std::string_view kPrefix = "xmlns:";
  for (const pugi::xml_attribute& attribute : root.attributes()) {
    const std::string_view name = attribute.name();
    if (name.substr(0, kPrefix.size()) == kPrefix) {
      out_.extensions.emplace_back(name.substr(kPrefix.size()), attribute.value());
    }
  }
  for (const char* const list : {"data3D", "images2D"}) {
    std::size_t number = 0;
    for (const pugi::xml_node& child : root.child(list).children()) {
      if (child.type() != pugi::node_element) continue;
      const std::string path = std::string("/") + list + "/" + std::to_string(number++);
      if (list[0] == 'd') {
        out_.scans.push_back(scan(child, path));
      } else {
        out_.images.push_back(image(child, path));
      }
    }
  }
}

}  // namespace

unsigned E57Field::bits() const {
  switch (kind) {
    case Kind::kFloat32:
      return 32;
    case Kind::kFloat64:
      return 64;
    case Kind::kString:
      return 0;
    case Kind::kInteger:
    case Kind::kScaledInteger:
      break;
  }
  const std::uint64_t range =
      static_cast<std::uint64_t>(maximum) - static_cast<std::uint64_t>(minimum);
  return range == 0 ? 0 : 64u - static_cast<unsigned>(__builtin_clzll(range));
}

std::optional<double> E57Scan::limit(const std::string& limit_name) const {
  for (const auto& [name_here, value] : limits) {
    if (name_here == limit_name) return value;
  }
  return {};
}

E57File read_e57_file(std::shared_ptr<const FileBytes> bytes, bool lenient,
                      std::unique_ptr<detail::E57Pages>* pages, std::vector<std::string>* notes) {
  E57File out;
  const FileBytes& file = *bytes;
  out.bytes = file.size();
  const std::string header = file.read(0, kHeaderSize);
  if (header.compare(0, 8, "ASTM-E57") != 0) {
    file.fail_at(0, "found " + shown(header.substr(0, 8)) + ", expected ASTM-E57");
  }
  std::uint32_t version[2];
  std::memcpy(version, header.data() + 8, sizeof version);
  if (version[0] != 1) {
    file.fail_at(8, "found version " + std::to_string(version[0]) + "." +
                        std::to_string(version[1]) + ", expected 1.0");
  }
  out.version_minor = static_cast<int>(std::min<std::uint32_t>(version[1], 1000));
  const std::uint64_t length = number64(header, 16), xml_place = number64(header, 24),
                      xml_length = number64(header, 32);
  out.page_size = number64(header, 40);
  constexpr std::uint64_t kLeastPage = 64, kMostPage = std::uint64_t{1} << 20;
  if (out.page_size < kLeastPage || out.page_size > kMostPage ||
      (out.page_size & (out.page_size - 1)) != 0) {
    file.fail_at(40, "found pages of " + std::to_string(out.page_size) +
                         " bytes, expected a power of two from 64 to 1048576 (1024 as a rule)");
  }
  out.pages = file.size() / out.page_size;
  if (length != file.size()) {
    const bool longer = length < file.size() && length % out.page_size == 0 && length > 0;
    const std::string found = "found a length of " + std::to_string(length) + " bytes, expected " +
                              std::to_string(file.size()) + ", the file's";
    if (!lenient && !longer) {
      file.fail_at(16, found + (length > file.size() ? " (is it cut?)" : ""));
    }
    notes->push_back("byte 16: " + found);
    if (longer) out.pages = length / out.page_size;
  } else if (length % out.page_size != 0) {
    const std::string found =
        "found a length that is no whole number of pages of " + std::to_string(out.page_size);
    if (!lenient) file.fail_at(16, found + " bytes");
    notes->push_back("byte 16: " + found + " bytes");
  }
  *pages = std::make_unique<detail::E57Pages>(bytes, out.page_size, out.pages, lenient);
  std::uint64_t xml_start = 0;
  if (!(*pages)->to_logical(xml_place, &xml_start) ||
      xml_length > (*pages)->logical_size() - xml_start) {
    file.fail_at(24, "found XML of " + std::to_string(xml_length) + " bytes from byte " +
                         std::to_string(xml_place) + ", expected it within the file");
  }
  unsigned char start[kHeaderSize];
  (*pages)->read(0, sizeof start, start);  // the header's own page is checked first
  std::string xml(static_cast<std::size_t>(xml_length), '\0');
  (*pages)->read(xml_start, xml.size(), reinterpret_cast<unsigned char*>(xml.data()));
  // Some writers count the zeros behind the text.
  xml.resize(xml.find_last_not_of('\0') + 1);
  pugi::xml_document document;
  const pugi::xml_parse_result parsed = document.load_buffer_inplace(
      xml.data(), xml.size(), pugi::parse_default, pugi::encoding_utf8);
  if (!parsed) {
    const std::uint64_t at =
        xml_start + static_cast<std::uint64_t>(std::max<std::ptrdiff_t>(0, parsed.offset));
    file.fail_at((*pages)->physical(at), "found damaged XML (" + std::string(parsed.description()) +
                                             "), expected a complete document");
  }
  XmlReader(file.name(), &out).read(document);
  return out;
}

}  // namespace camber
