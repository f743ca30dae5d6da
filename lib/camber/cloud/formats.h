#pragma once

#include <filesystem>
#include <memory>
#include <ostream>
#include <stdexcept>
#include <string>
#include <vector>

#include "camber/cloud/file_reader.h"
#include "camber/cloud/point_stream.h"

/// The readers and writers behind open_point_source and make_point_sink: one source file a
/// format, with what is large of it (header, writer) in files of its own beside it.
namespace camber {

std::unique_ptr<PointSource> open_pcd(std::unique_ptr<FileReader> file, const ReadOptions& options);
std::unique_ptr<PointSource> open_ply(std::unique_ptr<FileReader> file, const ReadOptions& options);
std::unique_ptr<PointSource> open_las(std::unique_ptr<FileReader> file, const ReadOptions& options);
std::unique_ptr<PointSource> open_e57(std::unique_ptr<FileReader> file, const ReadOptions& options);
std::unique_ptr<PointSource> open_text(std::unique_ptr<FileReader> file,
                                       const ReadOptions& options);
std::unique_ptr<PointSource> open_ptx(std::unique_ptr<FileReader> file, const ReadOptions& options);
std::unique_ptr<PointSource> open_kitti_bin(std::unique_ptr<FileReader> file,
                                            const ReadOptions& options);

/// points3D.bin, points3D.txt
std::unique_ptr<PointSource> open_colmap_points(std::unique_ptr<FileReader> file,
                                                const ReadOptions& options);

std::unique_ptr<PointSink> make_pcd_sink(std::ostream& out, const PointStreamHeader& header,
                                         CloudEncoding encoding);
std::unique_ptr<PointSink> make_ply_sink(std::ostream& out, const PointStreamHeader& header,
                                         CloudEncoding encoding);
std::unique_ptr<PointSink> make_kitti_bin_sink(std::ostream& out, const PointStreamHeader& header);
/// How the points of a LAS file are written.
enum class LasPoints {
  kPlain,
  kCompressed,  ///< LAZ
  kExtended,    ///< version 1.4 and point formats 6 to 8, not compressed: what COPC is made of
};
std::unique_ptr<PointSink> make_las_sink(std::ostream& out, const PointStreamHeader& header,
                                         LasPoints points);
/// The points of a LAS file into another one: for headers with records.
std::unique_ptr<PointSink> make_las_copy_sink(std::ostream& out, const PointStreamHeader& header,
                                              LasPoints points);
/// A COPC file. The points are sorted when all are there, what memory does not hold in files
/// without a name.
/// @param beside  the file that is written: these are in its folder
std::unique_ptr<PointSink> make_copc_sink(std::ostream& out, const PointStreamHeader& header,
                                          const std::filesystem::path& beside);
std::unique_ptr<PointSink> make_text_sink(std::ostream& out, const PointStreamHeader& header,
                                          CloudEncoding encoding);

/// What the readers share.
class FormatSource : public PointSource {
 protected:
  FormatSource(std::unique_ptr<FileReader> file, const ReadOptions& options)
      : file_(std::move(file)), options_(options), lines_(*file_) {}

  /// Takes "camber frame camera", "camber metric false", "camber origin X Y Z", "camber crs EPSG:n"
  /// (or well-known text, which "camber crs+" continues) or "camber unit H V" (metres) from a
  /// comment.
  void read_comment(std::string_view comment);

  /// Takes the coordinate system that the file states, or the one of the options instead. Units
  /// other than metres make the cloud not metric.
  void take_crs(const CoordinateSystem& of_file);

  /// Fails unless x and y are there; a missing z is noted (it reads as 0).
  void check_fields(const std::string& position);

  /// Where `count` points of at least `bytes` each cannot be in the rest of the file: fails or, if
  /// lenient, notes how many are missing and returns the number that fits.
  std::uint64_t check_count(std::uint64_t count, std::uint64_t bytes, std::uint64_t rest,
                            const std::string& what);

  std::unique_ptr<FileReader> file_;
  ReadOptions options_;
  LineReader lines_;

 private:
  void read_crs_comment(std::string_view key, std::string_view rest);

  std::string crs_text_;  // of the lines so far
};

/// Binary records of one size: hands out views into the file's window.
class RecordReader {
 public:
  struct Field {
    std::size_t offset = 0;
    ScalarType type = ScalarType::kFloat32;
  };
  RecordReader() = default;
  RecordReader(std::size_t record_size, std::vector<Field> fields, std::uint64_t count, bool swap);

  /// The next batch; false when all records have been read. The file must hold them.
  bool next(FileReader& file, PointBatch& batch);

 private:
  std::size_t record_size_ = 0;
  std::vector<Field> fields_;
  std::uint64_t left_ = 0;
  bool swap_ = false;
  std::size_t pending_ = 0;  ///< bytes of the last batch, still to be consumed
  std::vector<unsigned char> swapped_;
};

/// What is expected of one value of a text row.
struct ColumnRule {
  ScalarType type = ScalarType::kFloat64;  ///< integers must be whole and in the type's range
  bool packed_color = false;  ///< the bits of a float, or a whole number; becomes a whole number
  int column = -1;            ///< where the value goes, -1: skipped
};

/// Rows of numbers read from text, handed out as columns of the wanted types.
class RowBuffer {
 public:
  void start(std::vector<ScalarType> types);
  void set_type(std::size_t column, ScalarType type) { types_[column] = type; }
  const double* row(std::size_t i) const { return values_.data() + i * types_.size(); }
  double* new_row() {
    if ((rows_ + 1) * types_.size() > values_.size()) grow();
    return values_.data() + rows_ * types_.size();
  }
  void keep_row() { ++rows_; }
  bool full() const { return rows_ == kRows; }
  void clear() { rows_ = 0; }
  std::size_t rows() const { return rows_; }
  /// Views that are valid until the next fill().
  void fill(PointBatch& batch);

 private:
  static constexpr std::size_t kRows = 1024;
  /// Room for twice the rows: a wide table of few rows must not cost kRows of them.
  void grow();
  std::size_t rows_ = 0;
  std::vector<ScalarType> types_;
  std::vector<double> values_;
  std::vector<std::vector<unsigned char>> columns_;
};

/// Reads the values of one line, one for each rule, into `row`.
/// @param separator   ' ' for blanks alone; ',' or ';' with or without blanks beside it (blanks
///                    alone separate as well). Between two separators a NaN is read
///                    where the column can hold one.
/// @param fractional  if given, set to 1 for columns with a value that is not a whole number
/// @return empty, or what is wrong with the line.
std::string parse_row(std::string_view line, const std::vector<ColumnRule>& rules, char separator,
                      double* row, std::vector<unsigned char>* fractional = nullptr);

/// Whether a coordinate among the buffer's rows needs more than a float holds. Coordinates in text
/// may have all digits of a map's, whatever type the header claims.
bool has_large_values(const RowBuffer& rows, int column);

/// The header comments that carry a cloud's frame, scale and origin, without comment signs.
std::vector<std::string> camber_comments(const PointStreamHeader& header);

/// The name of a column in a file.
struct ColumnName {
  std::string name;
  bool fixed = false;  ///< by the format, as "x"
};

/// Makes names such as a format takes: blanks, line breaks and the characters in `others` become
/// '_'. Where another column has that name, '_' is appended until none has, and a note is added;
/// names that are fixed, then those that need no change, go first.
void make_names_unique(std::vector<ColumnName>& names, std::string_view others,
                       std::vector<std::string>* notes);

/// Whether x and y are angles, or belong to a system known by its code alone, which may have them.
bool may_be_angles(const PointStreamHeader& header);

/// Whether 4-byte floats hold the coordinates to a quarter of a millimetre: all are known to be
/// nearer than 8192 m (a float's step there is 0.5 mm) and none are angles.
bool floats_hold_coordinates(const PointStreamHeader& header);

/// Red, green and blue of any type as bytes, for formats whose readers take colours for them.
class ColorBytes {
 public:
  explicit ColorBytes(const PointStreamHeader& header);
  /// The colours of a batch; what counts as full is decided once for all batches: by the header,
  /// else by the first one.
  const std::vector<std::array<std::uint8_t, 3>>& convert(const PointBatch& batch);
  /// Adds a sentence if the bytes hold less than the values did.
  void add_note(std::vector<std::string>* notes) const;

 private:
  std::vector<PointField> fields_;
  std::array<int, 3> color_;
  bool bytes_ = false;  // the values are
  bool less_ = false;
  std::optional<double> full_;
  std::vector<std::array<std::uint8_t, 3>> out_;
};

/// Takes a step of writing a cloud's file; what the format cannot hold is an error that names it.
template <typename Step>
void write_step(const std::filesystem::path& path, Step&& step) {
  try {
    step();
  } catch (const std::invalid_argument& error) {
    throw std::invalid_argument(path.string() + ": " + error.what());
  }
}

/// Appends a value of a batch in its shortest text form.
void append_value(std::string& out, const FieldView& view, ScalarType type, std::size_t i);

/// Copies a batch into packed records, fields in order, optionally with bytes swapped.
void pack_records(const PointBatch& batch, const std::vector<PointField>& fields, bool swap,
                  std::string& out);

}  // namespace camber
