// PCD files of version 0.7 as PCL's own writer makes them: the packed rgb field, LZF.

#include <array>
#include <cmath>

#include "camber/cloud/formats.h"
#include "camber/cloud/lzf.h"
#include "camber/cloud/number_text.h"

namespace camber {
namespace {

constexpr std::array<double, 7> kNoViewpoint{0, 0, 0, 1, 0, 0, 0};

class PcdSink : public PointSink {
 public:
  PcdSink(std::ostream& out, const PointStreamHeader& header, CloudEncoding encoding)
      : out_(out), header_(header), encoding_(encoding), colors_(header) {
    if (encoding == CloudEncoding::kBigEndian) {
      throw std::invalid_argument(
          "PCD has no big-endian encoding, expected binary, ascii or compressed");
    }
    if (!header.count) start_ = out.tellp();
    roles_ = find_roles(header.fields);
    const bool floats = floats_hold_coordinates(header);
    std::vector<ColumnName> names;
    for (std::size_t f = 0; f < header.fields.size(); ++f) {
      const int index = static_cast<int>(f);
      if (index == roles_.color[1] || index == roles_.color[2]) continue;
      Column column;
      column.source = index;
      ColumnName name{header.fields[f].name};
      column.type = header.fields[f].type;
      if (index == roles_.color[0]) {
        name = {"rgb", true};
        column.type = ScalarType::kUint32;
        column.packed = true;
      }
      if (index == roles_.packed_color) {
        column.packed_already = true;
        name.fixed = true;
      }
      for (std::size_t axis = 0; axis < 3; ++axis) {
        static const char* const kAxes[] = {"x", "y", "z"};
        static const char* const kNormals[] = {"normal_x", "normal_y", "normal_z"};
        if (index == roles_.position[axis]) {
          name = {kAxes[axis], true};
          column.shortened = floats && column.type == ScalarType::kFloat64;
          if (column.shortened) column.type = ScalarType::kFloat32;
          doubles_ = doubles_ || column.type == ScalarType::kFloat64;
        }
        if (index == roles_.normal[axis]) name = {kNormals[axis], true};
      }
      names.push_back(name);
      columns_.push_back(column);
    }
    make_names_unique(names, {}, &name_notes_);
    for (std::size_t c = 0; c < columns_.size(); ++c) columns_[c].name = names[c].name;
    if (encoding == CloudEncoding::kCompressed) {
      collected_.resize(columns_.size());
    } else {
      write_header(header.count);
    }
  }

  void write(const PointBatch& batch) override {
    count_ += batch.count;
    PointBatch packed = repack(batch);
    if (encoding_ == CloudEncoding::kCompressed) {
      for (std::size_t c = 0; c < columns_.size(); ++c) {
        PointBatch one;
        one.count = batch.count;
        one.fields = {packed.fields[c]};
        PointField field;
        field.type = columns_[c].type;
        pack_records(one, {field}, false, collected_[c]);
      }
      return;
    }
    text_.clear();
    if (encoding_ == CloudEncoding::kAscii) {
      for (std::size_t i = 0; i < batch.count; ++i) {
        for (std::size_t c = 0; c < columns_.size(); ++c) {
          if (c > 0) text_ += ' ';
          append_value(text_, packed.fields[c], columns_[c].type, i);
        }
        text_ += '\n';
      }
    } else {
      pack_records(packed, fields_, false, text_);
    }
    out_.write(text_.data(), static_cast<std::streamsize>(text_.size()));
  }

  void finish() override {
    if (encoding_ == CloudEncoding::kCompressed) {
      write_header(count_);
      std::string all;
      for (std::string& column : collected_) {
        all += column;
        column = {};
      }
      const std::string compressed =
          lzf_compress(reinterpret_cast<const unsigned char*>(all.data()), all.size());
      if (all.size() > UINT32_MAX || compressed.size() > UINT32_MAX) {
        throw std::invalid_argument("the cloud has " + std::to_string(all.size()) +
                                    " bytes, expected fewer than 4 GiB for a compressed PCD");
      }
      const std::uint32_t sizes[2] = {static_cast<std::uint32_t>(compressed.size()),
                                      static_cast<std::uint32_t>(all.size())};
      out_.write(reinterpret_cast<const char*>(sizes), 8);
      out_.write(compressed.data(), static_cast<std::streamsize>(compressed.size()));
      return;
    }
    if (!header_.count) {
      const std::ostream::pos_type end = out_.tellp();
      out_.seekp(start_);
      write_header(count_);
      out_.seekp(end);
    }
  }

  std::vector<std::string> notes() const override {
    std::vector<std::string> notes = name_notes_;
    colors_.add_note(&notes);
    if (header_.height > 1 && count_ != std::uint64_t{header_.width} * header_.height) {
      notes.push_back("the points were in rows (" + std::to_string(header_.width) + " x " +
                      std::to_string(header_.height) +
                      ") and some are left out: the output is one row of points");
    }
    if (doubles_) {
      notes.emplace_back(
          "the coordinates are 8-byte floats, which hold those of maps; PCL's own point types have "
          "4-byte ones and are filled with 0 from them");
    }
    if (rounded_ > 0.0 && !header_.crs) {
      std::string note = "the coordinates, whose unit is not known, are rounded by up to ";
      append_number(note, static_cast<float>(rounded_));
      notes.push_back(note + " to 4-byte floats, as PCL's point types have");
    }
    return notes;
  }

 private:
  struct Column {
    int source = -1;
    std::string name;
    ScalarType type = ScalarType::kFloat32;
    bool packed = false;          // made from red, green, blue
    bool packed_already = false;  // 0xRRGGBB in the source
    bool shortened = false;       // made from doubles
  };

  PointBatch repack(const PointBatch& batch) {
    PointBatch out;
    out.count = batch.count;
    floats_.clear();
    floats_.reserve(3 * batch.count);  // views of it are handed out
    for (const Column& column : columns_) {
      if (column.shortened) {
        const FieldView view = batch.fields[static_cast<std::size_t>(column.source)];
        const float* const first = floats_.data() + floats_.size();
        for (std::size_t i = 0; i < batch.count; ++i) {
          const double exact = view.get<double>(i);
          floats_.push_back(static_cast<float>(exact));
          const double off = std::abs(static_cast<double>(floats_.back()) - exact);
          if (off > rounded_) rounded_ = off;
        }
        out.fields.push_back({reinterpret_cast<const unsigned char*>(first), sizeof(float)});
        continue;
      }
      if (!column.packed) {
        out.fields.push_back(batch.fields[static_cast<std::size_t>(column.source)]);
        continue;
      }
      packed_.clear();
      for (const auto& [red, green, blue] : colors_.convert(batch)) {
        packed_.push_back(static_cast<std::uint32_t>(red << 16 | green << 8 | blue));
      }
      out.fields.push_back({reinterpret_cast<const unsigned char*>(packed_.data()), 4});
    }
    return out;
  }

  /// @param count unknown: room is left for the largest number.
  void write_header(std::optional<std::uint64_t> count) {
    constexpr std::size_t kDigits = 20;
    std::string names, sizes, types, counts;
    fields_.clear();
    for (const Column& column : columns_) {
      names += ' ' + column.name;
      sizes += ' ' + std::to_string(size_of(column.type));
      // In binary data PCL wants the packed colour as a float, in ASCII as a whole number.
      const bool color_as_float = (column.packed || column.packed_already) &&
                                  encoding_ != CloudEncoding::kAscii && column.name != "rgba";
      types += is_float(column.type) || color_as_float ? " F"
               : column.type == ScalarType::kUint8 || column.type == ScalarType::kUint16 ||
                       column.type == ScalarType::kUint32 || column.type == ScalarType::kUint64
                   ? " U"
                   : " I";
      counts += " 1";
      PointField field;
      field.type = column.type;
      fields_.push_back(field);
    }
    const std::string number = count ? std::to_string(*count) : std::string(kDigits, '0');
    const bool organised =
        header_.height > 1 && count == std::uint64_t{header_.width} * header_.height;
    const std::string width = organised ? std::to_string(header_.width) : number;
    const std::string height = organised ? std::to_string(header_.height) : "1";
    std::string viewpoint;
    for (const double value : header_.viewpoint.value_or(kNoViewpoint)) {
      viewpoint += ' ';
      append_number(viewpoint, value);
    }
    std::string head = "# .PCD v0.7 - Point Cloud Data file format\n";
    for (const std::string& comment : camber_comments(header_)) head += "# " + comment + "\n";
    if (!header_.count && encoding_ != CloudEncoding::kCompressed) {
      const std::size_t used = number.size() + width.size() + height.size();
      head += "# " + std::string(2 * kDigits + 1 - used, '-') + "\n";
    }
    head += "VERSION 0.7\nFIELDS" + names + "\nSIZE" + sizes + "\nTYPE" + types + "\nCOUNT" +
            counts + "\nWIDTH " + width + "\nHEIGHT " + height + "\nVIEWPOINT" + viewpoint +
            "\nPOINTS " + number + "\nDATA " +
            (encoding_ == CloudEncoding::kAscii    ? "ascii"
             : encoding_ == CloudEncoding::kBinary ? "binary"
                                                   : "binary_compressed") +
            "\n";
    out_.write(head.data(), static_cast<std::streamsize>(head.size()));
  }

  std::ostream& out_;
  PointStreamHeader header_;
  CloudEncoding encoding_;
  FieldRoles roles_;
  ColorBytes colors_;
  std::vector<Column> columns_;
  std::vector<PointField> fields_;
  std::vector<std::string> name_notes_;
  std::vector<std::string> collected_;
  std::vector<std::uint32_t> packed_;
  std::vector<float> floats_;
  bool doubles_ = false;  // some coordinates are
  double rounded_ = 0.0;  // the most that a shortened coordinate is off
  std::string text_;
  std::uint64_t count_ = 0;
  std::ostream::pos_type start_ = 0;
};
}  // namespace

std::unique_ptr<PointSink> make_pcd_sink(std::ostream& out, const PointStreamHeader& header,
                                         CloudEncoding encoding) {
  return std::make_unique<PcdSink>(out, header, encoding);
}

}  // namespace camber
