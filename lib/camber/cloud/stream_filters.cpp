#include "camber/cloud/stream_filters.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <type_traits>

#include "camber/cloud/formats.h"
#include "camber/cloud/las_names.h"
#include "camber/cloud/number_text.h"
#include "camber/core/atomic_file.h"

namespace camber {
namespace {

constexpr double kLargestCoordinate = 1e9;  // m

/// A source in front of another one.
class Wrapper : public PointSource {
 protected:
  explicit Wrapper(std::unique_ptr<PointSource> source) : source_(std::move(source)) {
    header_ = source_->header();
    report_ = source_->report();
  }
  /// The inner report with this source's number of points; once the inner one has ended.
  void end() {
    const std::uint64_t points = report_.points;
    report_ = source_->report();
    report_.points = points;
    triangles_ = std::move(source_->triangles());
  }

  std::unique_ptr<PointSource> source_;
};

class Selected : public Wrapper {
 public:
  Selected(std::unique_ptr<PointSource> source, RowChoice choose)
      : Wrapper(std::move(source)), choose_(std::move(choose)) {
    header_.count.reset();
    report_.points = 0;
    columns_.resize(header_.fields.size());
  }

  bool next(PointBatch& batch) override {
    batch.clear();
    while (true) {
      if (!source_->next(inner_)) {
        end();
        finished();
        return false;
      }
      keep_.assign(inner_.count, 1);
      choose_(header_, inner_, &keep_);
      rows_.clear();
      for (std::size_t i = 0; i < inner_.count; ++i) {
        if (keep_[i] != 0) rows_.push_back(i);
      }
      if (!rows_.empty()) break;
    }
    report_.points += rows_.size();
    batch.count = rows_.size();
    if (rows_.size() == inner_.count) {
      batch.fields = inner_.fields;
      batch.records = inner_.records;
      return true;
    }
    if (inner_.records.data != nullptr) {
      const std::size_t size = inner_.records.stride;
      records_.resize(rows_.size() * size);
      for (std::size_t i = 0; i < rows_.size(); ++i) {
        std::memcpy(records_.data() + i * size, inner_.records.data + rows_[i] * size, size);
      }
      batch.records = {records_.data(), size};
    }
    for (std::size_t f = 0; f < columns_.size(); ++f) {
      std::vector<unsigned char>& column = columns_[f];
      const FieldView view = inner_.fields[f];
      with_type(header_.fields[f].type, [&](auto tag) {
        constexpr std::size_t kSize = sizeof(tag);
        column.resize(rows_.size() * kSize);
        for (std::size_t i = 0; i < rows_.size(); ++i) {
          std::memcpy(column.data() + i * kSize, view.data + rows_[i] * view.stride, kSize);
        }
        batch.fields.push_back({column.data(), kSize, view.fractional});
      });
    }
    return true;
  }

 protected:
  virtual void finished() {}

 private:
  RowChoice choose_;
  PointBatch inner_;
  std::vector<unsigned char> keep_;
  std::vector<std::size_t> rows_;
  std::vector<std::vector<unsigned char>> columns_;
  std::vector<unsigned char> records_;
};

/// Chooses by the coordinates.
RowChoice by_position(std::function<bool(const Eigen::Vector3d&)> keep) {
  return [keep = std::move(keep)](const PointStreamHeader& header, const PointBatch& batch,
                                  std::vector<unsigned char>* kept) {
    const std::array<int, 3> position = find_roles(header.fields).position;
    for (std::size_t i = 0; i < batch.count; ++i) {
      Eigen::Vector3d x = Eigen::Vector3d::Zero();
      for (std::size_t axis = 0; axis < 3; ++axis) {
        const int field = position[axis];
        if (field < 0) continue;
        const auto f = static_cast<std::size_t>(field);
        x[static_cast<Eigen::Index>(axis)] = batch.fields[f].number(header.fields[f].type, i);
      }
      if (!keep(x)) (*kept)[i] = 0;
    }
  };
}

class WithinBounds : public Selected {
 public:
  WithinBounds(std::unique_ptr<PointSource> source, const PlanBounds& bounds)
      : Selected(std::move(source), by_position([this, bounds](const Eigen::Vector3d& x) {
                   if (bounds.contains(x.x(), x.y())) return true;
                   ++outside_;
                   const Eigen::Vector2d place = x.head<2>();
                   if (place.allFinite()) extent_.extend(place);
                   return false;
                 })) {
    header_.bounds.reset();
  }

 protected:
  void finished() override {
    report_.outside = outside_;
    if (noted_ || report_.points > 0 || extent_.isEmpty()) return;
    noted_ = true;
    std::string note = "no point lies within the bounds; x is from ";
    append_number(note, extent_.min().x());
    append_number(note += " to ", extent_.max().x());
    append_number(note += ", y from ", extent_.min().y());
    append_number(note += " to ", extent_.max().y());
    report_.notes.push_back(std::move(note));
  }

 private:
  std::uint64_t outside_ = 0;
  Eigen::AlignedBox2d extent_;
  bool noted_ = false;
};

class WithoutBadPoints : public Selected {
 public:
  explicit WithoutBadPoints(std::unique_ptr<PointSource> source)
      : Selected(std::move(source), by_position([this](const Eigen::Vector3d& x) {
                   if (!x.allFinite()) {
                     ++not_finite_;
                     return false;
                   }
                   if (x.cwiseAbs().maxCoeff() > kLargestCoordinate) {
                     ++out_of_range_;
                     return false;
                   }
                   return true;
                 })) {}

 protected:
  void finished() override {
    if (counted_) return;
    counted_ = true;
    report_.drop("not finite", not_finite_);
    report_.drop("out of range", out_of_range_);
  }

 private:
  std::uint64_t not_finite_ = 0, out_of_range_ = 0;
  bool counted_ = false;
};

/// With an attribute of int or float.
template <class Number>
class Labelled : public Wrapper {
 public:
  Labelled(std::unique_ptr<PointSource> source, const std::string& name,
           const std::vector<Number>& values)
      : Wrapper(std::move(source)), values_(values) {
    for (std::size_t f = 0; f < header_.fields.size(); ++f) {
      if (header_.fields[f].name == name) replaced_ = f;
    }
    PointField field;
    field.name = name;
    static_assert(sizeof(Number) == 4);
    field.type = std::is_same_v<Number, float> ? ScalarType::kFloat32 : ScalarType::kInt32;
    field.changed = true;
    if (replaced_ < header_.fields.size()) {
      header_.fields[replaced_] = field;
    } else {
      header_.fields.push_back(field);
    }
    if (header_.count && *header_.count != values.size()) fail(*header_.count);
  }

  bool next(PointBatch& batch) override {
    const bool more = source_->next(batch);
    if (!more) {
      end();
      if (done_ != values_.size()) fail(done_);
      return false;
    }
    if (batch.count > values_.size() - done_) fail(done_ + batch.count);
    FieldView view;
    view.data = reinterpret_cast<const unsigned char*>(values_.data() + done_);
    view.stride = sizeof(Number);
    if (replaced_ < batch.fields.size()) {
      batch.fields[replaced_] = view;
    } else {
      batch.fields.push_back(view);
    }
    done_ += batch.count;
    report_.points = done_;
    return true;
  }

 private:
  [[noreturn]] void fail(std::uint64_t points) const {
    throw std::invalid_argument("found " + std::to_string(values_.size()) + " labels, expected " +
                                std::to_string(points) + ", one for each point");
  }

  const std::vector<Number>& values_;
  std::size_t replaced_ = std::numeric_limits<std::size_t>::max();
  std::size_t done_ = 0;
};

class WithCrs : public Wrapper {
 public:
  WithCrs(std::unique_ptr<PointSource> source, const std::optional<CoordinateSystem>& crs)
      : Wrapper(std::move(source)) {
    header_.crs = crs;
  }
  bool next(PointBatch& batch) override {
    const bool more = source_->next(batch);
    report_ = source_->report();
    return more;
  }
};

class WithLayout : public Wrapper {
 public:
  WithLayout(std::unique_ptr<PointSource> source, const PointStreamHeader& header, bool same_order)
      : Wrapper(std::move(source)) {
    header_.viewpoint = header.viewpoint;
    if (!same_order) return;
    header_.width = header.width;
    header_.height = header.height;
  }
  bool next(PointBatch& batch) override {
    const bool more = source_->next(batch);
    report_ = source_->report();
    return more;
  }
};

class WithNormals : public Wrapper {
 public:
  WithNormals(std::unique_ptr<PointSource> source, const std::vector<Eigen::Vector3f>& normals)
      : Wrapper(std::move(source)), normals_(normals) {
    for (std::size_t axis = 0; axis < 3; ++axis) {
      PointField field;
      field.name = std::string("n") + "xyz"[axis];
      field.changed = true;
      place_[axis] = header_.fields.size();
      for (std::size_t f = 0; f < header_.fields.size(); ++f) {
        if (header_.fields[f].name == field.name) place_[axis] = f;
      }
      if (place_[axis] == header_.fields.size()) {
        header_.fields.push_back(field);
      } else {
        header_.fields[place_[axis]] = field;
      }
    }
  }

  bool next(PointBatch& batch) override {
    if (!source_->next(batch)) {
      end();
      if (done_ != normals_.size()) fail(done_);
      return false;
    }
    if (batch.count > normals_.size() - done_) fail(done_ + batch.count);
    batch.fields.resize(header_.fields.size());
    for (std::size_t axis = 0; axis < 3; ++axis) {
      batch.fields[place_[axis]] = {
          reinterpret_cast<const unsigned char*>(normals_[done_].data() + axis),
          sizeof(Eigen::Vector3f)};
    }
    done_ += batch.count;
    report_.points = done_;
    return true;
  }

 private:
  [[noreturn]] void fail(std::uint64_t points) const {
    throw std::invalid_argument("found " + std::to_string(normals_.size()) + " normals, expected " +
                                std::to_string(points) + ", one for each point");
  }

  const std::vector<Eigen::Vector3f>& normals_;
  std::array<std::size_t, 3> place_{};
  std::size_t done_ = 0;
};

class Classified : public Wrapper {
 public:
  Classified(std::unique_ptr<PointSource> source, const std::vector<int>& ground)
      : Wrapper(std::move(source)), ground_(ground) {
    for (std::size_t f = 0; f < header_.fields.size(); ++f) {
      const std::string& name = header_.fields[f].name;
      if (las_attribute(name) != "classification" || (had_ && name != "classification")) continue;
      place_ = f;
      old_type_ = header_.fields[f].type;
      had_ = true;
    }
    PointField field;
    field.name = "classification";
    field.type = ScalarType::kUint8;
    field.changed = true;
    if (had_) {
      header_.fields[place_] = field;
    } else {
      place_ = header_.fields.size();
      header_.fields.push_back(field);
    }
  }

  bool next(PointBatch& batch) override {
    if (!source_->next(batch)) {
      end();
      if (done_ != ground_.size()) fail(done_);
      return false;
    }
    if (batch.count > ground_.size() - done_) fail(done_ + batch.count);
    classes_.resize(batch.count);
    for (std::size_t i = 0; i < batch.count; ++i) {
      const double old = had_ ? batch.fields[place_].number(old_type_, i) : 0.0;
      const std::uint8_t before = static_cast<std::uint8_t>(old >= 0.0 && old <= 255.0 ? old : 0.0);
      const int ground = ground_[done_ + i];
      classes_[i] = ground < 0                         ? before
                    : ground > 0                       ? kGround
                    : before == 0 || before == kGround ? kUnclassified
                                                       : before;
    }
    batch.fields.resize(header_.fields.size());
    batch.fields[place_] = {classes_.data(), 1};
    done_ += batch.count;
    report_.points = done_;
    return true;
  }

 private:
  static constexpr std::uint8_t kUnclassified = 1, kGround = 2;

  [[noreturn]] void fail(std::uint64_t points) const {
    throw std::invalid_argument("found " + std::to_string(ground_.size()) + " labels, expected " +
                                std::to_string(points) + ", one for each point");
  }

  const std::vector<int>& ground_;
  std::size_t place_ = 0;
  ScalarType old_type_ = ScalarType::kUint8;
  bool had_ = false;
  std::vector<std::uint8_t> classes_;
  std::size_t done_ = 0;
};

class Retyped : public Wrapper {
 public:
  /// @param whole  columns of text that are integer ones
  /// @param intensity  the column of intensities that fit into LAS's own field, -1 for none
  Retyped(std::unique_ptr<PointSource> source, const std::vector<bool>& whole, int intensity,
          const std::optional<double>& full_color, const std::optional<Eigen::AlignedBox3d>& bounds)
      : Wrapper(std::move(source)), whole_(whole), columns_(whole.size()) {
    header_.full_color = full_color;
    header_.bounds = bounds;
    report_.points = 0;
    for (std::size_t f = 0; f < whole_.size(); ++f) {
      header_.fields[f].text = false;
      if (whole_[f]) header_.fields[f].type = ScalarType::kInt32;
    }
    if (intensity >= 0) header_.fields[static_cast<std::size_t>(intensity)].fits_uint16 = true;
  }

  bool next(PointBatch& batch) override {
    if (!source_->next(batch)) {
      end();
      return false;
    }
    for (std::size_t f = 0; f < whole_.size(); ++f) {
      if (!whole_[f]) continue;
      columns_[f].resize(batch.count);
      for (std::size_t i = 0; i < batch.count; ++i) {
        // The first pass has found them in range; a file that changed since then gets a zero.
        const double value = batch.fields[f].get<double>(i);
        columns_[f][i] = std::abs(value) <= 2147483647.0 ? static_cast<std::int32_t>(value) : 0;
      }
      batch.fields[f].data = reinterpret_cast<const unsigned char*>(columns_[f].data());
      batch.fields[f].stride = sizeof(std::int32_t);
    }
    report_.points += batch.count;
    return true;
  }

 private:
  std::vector<bool> whole_;
  std::vector<std::vector<std::int32_t>> columns_;
};

}  // namespace

std::unique_ptr<PointSource> select_points(std::unique_ptr<PointSource> source,
                                           std::function<bool(const Eigen::Vector3d&)> keep) {
  return std::make_unique<Selected>(std::move(source), by_position(std::move(keep)));
}

std::unique_ptr<PointSource> select_rows(std::unique_ptr<PointSource> source, RowChoice choose) {
  return std::make_unique<Selected>(std::move(source), std::move(choose));
}

std::unique_ptr<PointSource> within_bounds(std::unique_ptr<PointSource> source,
                                           const PlanBounds& bounds) {
  return std::make_unique<WithinBounds>(std::move(source), bounds);
}

std::unique_ptr<PointSource> drop_bad_points(std::unique_ptr<PointSource> source) {
  return std::make_unique<WithoutBadPoints>(std::move(source));
}

std::unique_ptr<PointSource> add_label(std::unique_ptr<PointSource> source, const std::string& name,
                                       const std::vector<int>& values) {
  return std::make_unique<Labelled<int>>(std::move(source), name, values);
}

std::unique_ptr<PointSource> add_numbers(std::unique_ptr<PointSource> source,
                                         const std::string& name,
                                         const std::vector<float>& values) {
  return std::make_unique<Labelled<float>>(std::move(source), name, values);
}

std::unique_ptr<PointSource> add_normals(std::unique_ptr<PointSource> source,
                                         const std::vector<Eigen::Vector3f>& normals) {
  return std::make_unique<WithNormals>(std::move(source), normals);
}

std::unique_ptr<PointSource> with_crs(std::unique_ptr<PointSource> source,
                                      const std::optional<CoordinateSystem>& crs) {
  return std::make_unique<WithCrs>(std::move(source), crs);
}

std::unique_ptr<PointSource> with_layout(std::unique_ptr<PointSource> source,
                                         const PointStreamHeader& header, bool same_order) {
  return std::make_unique<WithLayout>(std::move(source), header, same_order);
}

std::unique_ptr<PointSource> classify_ground(std::unique_ptr<PointSource> source,
                                             const std::vector<int>& ground) {
  return std::make_unique<Classified>(std::move(source), ground);
}

std::unique_ptr<PointSource> open_typed_source(const std::filesystem::path& path,
                                               const ReadOptions& options,
                                               std::optional<CloudFormat> output) {
  std::unique_ptr<PointSource> source = open_point_source(path, options);
  const PointStreamHeader& header = source->header();
  const FieldRoles roles = find_roles(header.fields);
  const std::optional<double> by_type = full_color_by_type(header.fields);
  const bool to_bytes = output == CloudFormat::kPly || output == CloudFormat::kPcd;
  const bool open_colors = roles.color[0] >= 0 && (!by_type || (to_bytes && *by_type > 255.0));
  const bool doubles = std::any_of(roles.position.begin(), roles.position.end(), [&](int field) {
    return field >= 0 &&
           header.fields[static_cast<std::size_t>(field)].type == ScalarType::kFloat64;
  });
  const bool open_coordinates = (output == CloudFormat::kPcd && doubles) ||
                                (is_las(output) && !header.grid && may_be_angles(header));
  int intensity = -1;  // in floats, for LAS, whose own field holds whole numbers
  for (const int field : roles.others) {
    const PointField& f = header.fields[static_cast<std::size_t>(field)];
    if (is_las(output) && is_float(f.type) && las_attribute(f.name) == "intensity" &&
        (intensity < 0 || f.name == "intensity")) {
      intensity = field;
    }
  }
  if (source->report().format != CloudFormat::kText && !open_colors && !open_coordinates &&
      intensity < 0) {
    return source;
  }
  std::vector<bool> whole;
  for (const PointField& field : header.fields) whole.push_back(field.text);
  for (const int field : roles.position) {
    if (field >= 0) whole[static_cast<std::size_t>(field)] = false;
  }
  GreatestColor greatest(header.fields);
  Eigen::AlignedBox3d bounds;
  PointBatch batch;
  while (source->next(batch)) {
    greatest.add(batch);
    for (std::size_t axis = 0; open_coordinates && axis < 3; ++axis) {
      const int field = roles.position[axis];
      const auto f = static_cast<std::size_t>(field);
      const auto a = static_cast<Eigen::Index>(axis);
      for (std::size_t i = 0; i < batch.count; ++i) {
        const double x = field < 0 ? 0.0 : batch.fields[f].number(header.fields[f].type, i);
        // Lenient reading leaves out what is farther.
        if (!std::isfinite(x) || (options.lenient && std::abs(x) > kLargestCoordinate)) continue;
        bounds.min()[a] = std::min(bounds.min()[a], x);
        bounds.max()[a] = std::max(bounds.max()[a], x);
      }
    }
    for (std::size_t i = 0; intensity >= 0 && i < batch.count; ++i) {
      const auto f = static_cast<std::size_t>(intensity);
      if (!is_uint16(batch.fields[f].number(header.fields[f].type, i))) intensity = -1;
    }
    for (std::size_t f = 0; f < whole.size(); ++f) {
      if (!whole[f]) continue;
      bool good = !batch.fields[f].fractional;
      for (std::size_t i = 0; good && i < batch.count; ++i) {
        good = std::abs(batch.fields[f].get<double>(i)) <= 2147483647.0;
      }
      whole[f] = good;
    }
  }
  std::optional<double> full_color;
  std::optional<Eigen::AlignedBox3d> box;
  if (open_colors) full_color = greatest.full_color();
  if (open_coordinates) box = bounds;
  return std::make_unique<Retyped>(open_point_source(path, options), whole, intensity, full_color,
                                   box);
}

std::uint64_t write_points(PointSource& source, const std::filesystem::path& path,
                           const WriteOptions& options, const Progress& progress,
                           std::vector<std::string>* notes) {
  const std::optional<CloudFormat> format =
      options.format ? options.format : format_from_extension(path);
  if (!format) {
    throw std::invalid_argument(
        "output " + path.string() +
        ": found an unknown extension, expected .ply, .pcd, .bin, .las, .laz, "
        ".xyz or .csv");
  }
  const CloudEncoding encoding = encoding_for(path, *format, options.encoding);
  std::uint64_t count = 0;
  write_file_atomically(path, [&](std::ostream& out) {
    std::unique_ptr<PointSink> sink;
    write_step(path,
               [&] { sink = make_point_sink(out, source.header(), *format, encoding, path); });
    const double total = static_cast<double>(
        std::max<std::uint64_t>(source.header().count.value_or(source.report().declared), 1));
    PointBatch batch;
    while (source.next(batch)) {
      write_step(path, [&] { sink->write(batch); });
      count += batch.count;
      if (!out) break;  // a full disk; reported by the writer of the file
      if (progress) progress("write", std::min(1.0, static_cast<double>(count) / total));
    }
    write_step(path, [&] { sink->finish(); });
    if (notes) *notes = sink->notes();
  });
  return count;
}

void write_labelled_copy(const std::filesystem::path& input, const ReadOptions& read_options,
                         const std::string& name, const std::vector<int>& values,
                         const std::filesystem::path& output, const WriteOptions& write_options,
                         std::vector<std::string>* notes) {
  std::unique_ptr<PointSource> points = open_typed_source(
      input, read_options,
      write_options.format ? write_options.format : format_from_extension(output));
  if (read_options.lenient) points = drop_bad_points(std::move(points));
  const auto source = add_label(std::move(points), name, values);
  write_points(*source, output, write_options, {}, notes);
}

}  // namespace camber
