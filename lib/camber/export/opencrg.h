#pragma once

#include <Eigen/Core>
#include <filesystem>
#include <limits>
#include <optional>
#include <ostream>
#include <string>
#include <utility>
#include <vector>

namespace camber {

/// What a road is beyond the edge of its grid: BORDER_MODE_U and BORDER_MODE_V of a file, 0 to 4.
enum class CrgBorder { kNone, kZero, kKeep, kRepeat, kReflect };

/// $ROAD_CRG_OPTS, as far as it changes heights and positions.
struct CrgOptions {
  CrgBorder border_u = CrgBorder::kKeep, border_v = CrgBorder::kKeep;
  double offset_u = 0.0, offset_v = 0.0;           ///< m, added beyond the edge
  std::optional<double> smooth_begin, smooth_end;  ///< m of u over which heights fade in and out
  bool close_track = false;  ///< REFLINE_CONTINUATION = 1: the end leads to the start
};

/// What to do with unknown cells before anything is asked: GRID_NAN_MODE.
enum class CrgUnknown { kKeep, kZero, kLast };

/// $ROAD_CRG_MODS: changes to the data before anything is asked, in the order of these fields.
struct CrgModifiers {
  std::optional<double> scale_heights, scale_slope, scale_banking, scale_length, scale_width,
      scale_curvature;
  std::optional<CrgUnknown> unknown;
  double unknown_offset = 0.0;  ///< m, added to cells that were unknown
  /// The place (u, v) goes to (x, y, z) with the heading phi. Where none of these is given the
  /// offsets below apply.
  std::optional<double> point_u, point_u_fraction, point_v, point_v_fraction, point_x, point_y,
      point_z, point_phi;
  double point_u_offset = 0.0, point_v_offset = 0.0;
  std::optional<double> offset_x, offset_y, offset_z, offset_phi, centre_x, centre_y;

  /// Those of a file without the block: unknown cells take the last value of their cross section.
  /// (ASAM's C reader then also moves the start of the road to the origin. Coordinates stay those
  /// of the file here.)
  static CrgModifiers defaults();
};

/// How an OpenCRG file holds its numbers.
enum class CrgEncoding {
  kText,         ///< LRFI: readable, 10 characters a number
  kTextDouble,   ///< LDFI: readable, 20 characters
  kBinary,       ///< KRBI: 4 bytes
  kBinaryDouble  ///< KDBI: 8 bytes
};
std::string_view to_string(CrgEncoding encoding);  ///< "LRFI", "LDFI", "KRBI", "KDBI"

/// The contents of an OpenCRG file (ASAM OpenCRG 1.1): a reference line of equal steps in u and
/// heights beside it at the places v, m, v positive to the left. Heights are above the reference
/// line's elevation plus banking times v.
struct CrgData {
  std::string comment;  ///< $CT
  CrgEncoding encoding = CrgEncoding::kText;
  double start_u = 0.0, start_x = 0.0, start_y = 0.0, start_z = 0.0, start_phi = 0.0;
  bool has_start_z = false;
  std::optional<double> end_u, end_x, end_y, end_z, end_phi;
  double start_slope = 0.0, start_banking = 0.0;  ///< of the whole line, where there is no channel
  double increment = 0.01;                        ///< m of u between cross sections
  std::vector<double> v;                          ///< m, ascending: right to left; at least 2
  double v_right = 0.0, v_left = 0.0;             ///< edges beyond which the border modes hold
  bool numbered = false;  ///< sections given by number and increment, not by position
  /// One entry a cross section, or none: heading of the step that leads to it (rad; the first is
  /// start_phi), slope of that step, banking at it.
  std::vector<double> phi, slope, banking;
  std::vector<float> heights;  ///< m, sections() rows of v.size(); NaN: unknown
  CrgOptions options;
  std::optional<CrgModifiers> modifiers;  ///< none: the file has no such block
  /// Further entries of $ROAD_CRG (REFERENCE_LINE_START_LON ...), and blocks not known here.
  std::vector<std::pair<std::string, double>> other;
  std::vector<std::string> remarks;          ///< of the reader: what it had to assume
  std::vector<std::filesystem::path> files;  ///< read: the file itself, then those it names

  std::size_t sections() const { return v.empty() ? 0 : heights.size() / v.size(); }
};

/// Reads a file and those that it names ($ROAD_CRG_FILE: counted from the file's own folder, then
/// from the current one; $NAME is a variable of the environment). What those hold enters no
/// message.
/// @param folder  in which the files that it names must lie, links followed; empty: anywhere.
/// @throws InputError: what was found and expected, where.
CrgData read_crg(const std::filesystem::path& path, const std::filesystem::path& folder = {});

/// Writes the data in its encoding (kText or kBinary); values are rounded to what the file holds.
/// @throws std::invalid_argument where the arrays do not fit, OutputError.
void write_crg(const CrgData& data, std::ostream& out);
void write_crg(const CrgData& data, const std::filesystem::path& path);  ///< atomically

/// A value as a file of this encoding gives it back.
double crg_rounded(double value, CrgEncoding encoding);

/// Heights of an OpenCRG road at any place, as ASAM's C reader 1.2 gives them, border modes and
/// modifiers included. Immutable: any number of threads may ask.
class CrgRoad {
 public:
  /// @param modify  apply the modifiers of the file or, where it has none, the default ones.
  explicit CrgRoad(const CrgData& data, bool modify = true);

  double first_u() const { return first_u_; }
  double last_u() const { return last_u_; }
  double increment() const { return increment_; }
  double right() const { return v_right_; }
  double left() const { return v_left_; }
  std::size_t sections() const { return x_.size(); }
  const std::vector<double>& v() const { return v_; }
  bool closed() const { return closed_; }  ///< the line's end leads to its start

  /// m; NaN where the grid is unknown, or beyond it with the border mode kNone.
  double height(double u, double v) const;
  double height_at(double x, double y) const;

  Eigen::Vector2d position(double u, double v) const;     ///< x, y
  Eigen::Vector2d coordinates(double x, double y) const;  ///< u, v
  double heading(double u) const;                         ///< rad, of the reference line
  double reference_height(std::size_t section) const;     ///< m, of the reference line
  double banking(std::size_t section) const;
  /// m, of a node of the grid above the origin of z; NaN: unknown.
  double node(std::size_t section, std::size_t column) const;

 private:
  struct Cell {
    std::size_t index = 0;
    double share = 0.0;
  };
  struct Side {
    Cell cell;
    double at = 0.0;       ///< the coordinate, brought back inside where it repeats
    bool inside = true;    ///< of the grid, or of its repetition
    bool nothing = false;  ///< the border mode answers nothing
    bool zero = false;     ///< the border mode answers zero
    double offset = 0.0;   ///< m
  };

  void place_line(const CrgData& data, bool use_end);
  void raise_line(bool use_end);
  void find_closure();
  void modify(const CrgData& data, const CrgModifiers& modifiers);
  void fill_unknown(CrgUnknown mode, double offset);
  void move(const CrgModifiers& modifiers);
  void move_heights(double by);
  double wrapped(double u) const;
  Side side_u(double u) const;
  Side side_v(double v) const;
  Cell cell_of_v(double v) const;
  double smoothed(double height, double u) const;
  double end_height(bool last) const;
  std::size_t nearest_step(double x, double y) const;
  float& stored(std::size_t section, std::size_t column) {
    return heights_[section * v_.size() + column];
  }
  float stored(std::size_t section, std::size_t column) const {
    return heights_[section * v_.size() + column];
  }

  CrgOptions options_;
  double first_u_ = 0.0, last_u_ = 0.0, increment_ = 1.0;
  double v_right_ = 0.0, v_left_ = 0.0;
  bool numbered_ = false;
  std::vector<double> v_;
  std::vector<double> phi_, slope_, banking_;
  std::vector<double> x_, y_, z_;  ///< of the reference line; z_ empty: level, at first_z_
  double first_x_ = 0.0, first_y_ = 0.0, last_x_ = 0.0, last_y_ = 0.0;
  double first_phi_ = 0.0, last_phi_ = 0.0;
  double first_z_ = 0.0, last_z_ = 0.0;
  bool has_start_z_ = false, has_end_z_ = false;
  double start_slope_ = 0.0, start_banking_ = 0.0;
  double grid_offset_ = 0.0;  ///< m, of all stored heights
  std::vector<float> heights_;
  bool closed_ = false;
  double close_min_ = 0.0, close_max_ = 0.0;  ///< u between which a closed line runs
};

}  // namespace camber
