// Points as text: one a line, blanks or commas between the values.

#include "camber/cloud/formats.h"
#include "camber/cloud/number_text.h"

namespace camber {
namespace {

class TextSink : public PointSink {
 public:
  TextSink(std::ostream& out, const PointStreamHeader& header, CloudEncoding encoding)
      : out_(out), header_(header), separator_(encoding == CloudEncoding::kCommas ? ',' : ' ') {
    if (encoding != CloudEncoding::kBinary && encoding != CloudEncoding::kAscii &&
        encoding != CloudEncoding::kCommas) {
      throw std::invalid_argument("text has no big-endian or compressed encoding");
    }
    packed_ = find_roles(header.fields).packed_color;
    std::string head;
    for (const std::string& comment : camber_comments(header)) head += "# " + comment + "\n";
    if (separator_ == ' ') head += "# ";
    std::vector<ColumnName> names;
    for (std::size_t f = 0; f < header.fields.size(); ++f) {
      if (static_cast<int>(f) == packed_) {
        for (const char* const channel : {"red", "green", "blue"}) names.push_back({channel, true});
      } else {
        names.push_back({header.fields[f].name});
      }
    }
    make_names_unique(names, ",;\"", &name_notes_);
    for (std::size_t c = 0; c < names.size(); ++c) {
      if (c > 0) head += separator_;
      head += names[c].name;
    }
    head += '\n';
    out_.write(head.data(), static_cast<std::streamsize>(head.size()));
  }

  void write(const PointBatch& batch) override {
    text_.clear();
    for (std::size_t i = 0; i < batch.count; ++i) {
      for (std::size_t f = 0; f < batch.fields.size(); ++f) {
        if (f > 0) text_ += separator_;
        if (static_cast<int>(f) == packed_) {
          const std::uint32_t rgb = batch.fields[f].get<std::uint32_t>(i);
          for (const unsigned shift : {16u, 8u, 0u}) {
            append_number(text_, static_cast<std::uint64_t>(rgb >> shift & 255u));
            if (shift > 0) text_ += separator_;
          }
          continue;
        }
        const std::size_t start = text_.size();
        append_value(text_, batch.fields[f], header_.fields[f].type, i);
        // So that an attribute that is not an integer one does not look like one.
        if (is_float(header_.fields[f].type) && !header_.fields[f].text &&
            text_.find_first_not_of("-0123456789", start) == std::string::npos) {
          text_ += ".0";
        }
      }
      text_ += '\n';
    }
    out_.write(text_.data(), static_cast<std::streamsize>(text_.size()));
  }

  void finish() override {}

  std::vector<std::string> notes() const override { return name_notes_; }

 private:
  std::ostream& out_;
  PointStreamHeader header_;
  char separator_;
  int packed_ = -1;
  std::vector<std::string> name_notes_;
  std::string text_;
};

}  // namespace

std::unique_ptr<PointSink> make_text_sink(std::ostream& out, const PointStreamHeader& header,
                                          CloudEncoding encoding) {
  return std::make_unique<TextSink>(out, header, encoding);
}

}  // namespace camber
