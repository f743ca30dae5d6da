// PLY files: Greg Turk's polygon format (1994), written with the type names of its first version.

#include "camber/cloud/formats.h"
#include "camber/cloud/number_text.h"

namespace camber {
namespace {

const char* name_of(ScalarType type) {
  switch (type) {
    case ScalarType::kInt8:
      return "char";
    case ScalarType::kUint8:
      return "uchar";
    case ScalarType::kInt16:
      return "short";
    case ScalarType::kUint16:
      return "ushort";
    case ScalarType::kInt32:
      return "int";
    case ScalarType::kUint32:
      return "uint";
    case ScalarType::kInt64:
      return "int64";
    case ScalarType::kUint64:
      return "uint64";
    case ScalarType::kFloat32:
      return "float";
    case ScalarType::kFloat64:
      break;
  }
  return "double";
}

class PlySink : public PointSink {
 public:
  PlySink(std::ostream& out, const PointStreamHeader& header, CloudEncoding encoding)
      : out_(out), header_(header), encoding_(encoding), colors_(header) {
    if (encoding == CloudEncoding::kCompressed) {
      throw std::invalid_argument(
          "PLY has no compressed encoding, expected binary, ascii or big endian");
    }
    if (!header.count) start_ = out.tellp();
    const FieldRoles roles = find_roles(header.fields);
    channels_ = roles.color;
    std::vector<ColumnName> names;
    for (std::size_t f = 0; f < header.fields.size(); ++f) {
      const int index = static_cast<int>(f);
      if (index == roles.packed_color) {
        for (const char* const channel : {"red", "green", "blue"}) {
          add(index, ScalarType::kUint8);
          names.push_back({channel, true});
        }
        continue;
      }
      ColumnName name{header.fields[f].name};
      ScalarType type = header.fields[f].type;
      for (std::size_t axis = 0; axis < 3; ++axis) {
        static const char* const kAxes[] = {"x", "y", "z"};
        static const char* const kNormals[] = {"nx", "ny", "nz"};
        static const char* const kColors[] = {"red", "green", "blue"};
        if (index == roles.position[axis]) name = {kAxes[axis], true};
        if (index == roles.normal[axis]) name = {kNormals[axis], true};
        if (index == roles.color[axis]) {
          name = {kColors[axis], true};
          type = ScalarType::kUint8;
        }
      }
      add(index, type);
      names.push_back(name);
    }
    make_names_unique(names, {}, &name_notes_);
    for (std::size_t c = 0; c < fields_.size(); ++c) fields_[c].name = names[c].name;
    packed_ = roles.packed_color;
    write_header(header.count);
  }

  void write(const PointBatch& batch) override {
    count_ += batch.count;
    PointBatch columns;
    columns.count = batch.count;
    const std::array<std::uint8_t, 3>* colors = nullptr;
    if (channels_[0] >= 0) colors = colors_.convert(batch).data();
    std::size_t channel = 2;  // of a little-endian 0xRRGGBB
    for (const int source : sources_) {
      FieldView view = batch.fields[static_cast<std::size_t>(source)];
      if (source == packed_) view.data += channel--;
      for (std::size_t c = 0; c < 3; ++c) {
        if (source == channels_[c]) view = {reinterpret_cast<const unsigned char*>(colors) + c, 3};
      }
      columns.fields.push_back(view);
    }
    text_.clear();
    if (encoding_ == CloudEncoding::kAscii) {
      for (std::size_t i = 0; i < batch.count; ++i) {
        for (std::size_t c = 0; c < fields_.size(); ++c) {
          if (c > 0) text_ += ' ';
          append_value(text_, columns.fields[c], fields_[c].type, i);
        }
        text_ += '\n';
      }
    } else {
      pack_records(columns, fields_, encoding_ == CloudEncoding::kBigEndian, text_);
    }
    out_.write(text_.data(), static_cast<std::streamsize>(text_.size()));
  }

  void finish() override {
    if (header_.count) return;
    const std::ostream::pos_type end = out_.tellp();
    out_.seekp(start_);
    write_header(count_);
    out_.seekp(end);
  }

  std::vector<std::string> notes() const override {
    std::vector<std::string> notes = name_notes_;
    colors_.add_note(&notes);
    return notes;
  }

 private:
  void add(int source, ScalarType type) {
    PointField field;
    field.type = type;
    fields_.push_back(field);
    sources_.push_back(source);
  }

  /// @param count unknown: room is left for the largest number.
  void write_header(std::optional<std::uint64_t> count) {
    constexpr std::size_t kDigits = 20;
    const std::string number = count ? std::to_string(*count) : std::string(kDigits, '0');
    std::string head = "ply\nformat ";
    head += encoding_ == CloudEncoding::kAscii    ? "ascii"
            : encoding_ == CloudEncoding::kBinary ? "binary_little_endian"
                                                  : "binary_big_endian";
    head += " 1.0\n";
    for (const std::string& comment : camber_comments(header_)) head += "comment " + comment + "\n";
    if (!header_.count) head += "comment " + std::string(kDigits - number.size(), '-') + "\n";
    head += "element vertex " + number + "\n";
    for (const PointField& field : fields_) {
      head += std::string("property ") + name_of(field.type) + " " + field.name + "\n";
    }
    head += "end_header\n";
    out_.write(head.data(), static_cast<std::streamsize>(head.size()));
  }

  std::ostream& out_;
  PointStreamHeader header_;
  CloudEncoding encoding_;
  std::vector<PointField> fields_;
  std::vector<int> sources_;
  std::vector<std::string> name_notes_;
  std::array<int, 3> channels_{-1, -1, -1};
  ColorBytes colors_;
  int packed_ = -1;
  std::string text_;
  std::uint64_t count_ = 0;
  std::ostream::pos_type start_ = 0;
};

}  // namespace

std::unique_ptr<PointSink> make_ply_sink(std::ostream& out, const PointStreamHeader& header,
                                         CloudEncoding encoding) {
  return std::make_unique<PlySink>(out, header, encoding);
}

}  // namespace camber
