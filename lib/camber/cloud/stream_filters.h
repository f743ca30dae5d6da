#pragma once

#include <filesystem>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "camber/cloud/point_stream.h"
#include "camber/core/progress.h"

namespace camber {

/// Passes on the points of a source for which `keep` holds. The count is not known beforehand.
/// @param keep gets true coordinates, m, and returns whether the point stays.
std::unique_ptr<PointSource> select_points(std::unique_ptr<PointSource> source,
                                           std::function<bool(const Eigen::Vector3d&)> keep);

/// Passes on the points within bounds, and counts the others (ReadReport::outside); a note states
/// where the points are if none is inside.
std::unique_ptr<PointSource> within_bounds(std::unique_ptr<PointSource> source,
                                           const PlanBounds& bounds);

/// Gets the points of a batch and an array with a 1 for each of them, in which it sets 0 for those
/// that go.
using RowChoice = std::function<void(const PointStreamHeader&, const PointBatch&,
                                     std::vector<unsigned char>* keep)>;

/// Passes on the points that a choice leaves. The count is not known beforehand.
std::unique_ptr<PointSource> select_rows(std::unique_ptr<PointSource> source, RowChoice choose);

/// Leaves out points that are not finite or farther than 1e9 m from zero, as lenient reading does,
/// and counts them in the report.
std::unique_ptr<PointSource> drop_bad_points(std::unique_ptr<PointSource> source);

/// Adds an integer attribute, or replaces the one of that name. The source must have as many points
/// as there are values (std::invalid_argument at the end otherwise); `values` must outlive it.
std::unique_ptr<PointSource> add_label(std::unique_ptr<PointSource> source, const std::string& name,
                                       const std::vector<int>& values);

/// The same of 4-byte floats.
std::unique_ptr<PointSource> add_numbers(std::unique_ptr<PointSource> source,
                                         const std::string& name, const std::vector<float>& values);

/// Adds normals nx ny nz, or replaces them. The source must have as many points as there are
/// normals; `normals` must outlive it.
std::unique_ptr<PointSource> add_normals(std::unique_ptr<PointSource> source,
                                         const std::vector<Eigen::Vector3f>& normals);

/// Gives a stream the coordinate system of the file that its points come from.
std::unique_ptr<PointSource> with_crs(std::unique_ptr<PointSource> source,
                                      const std::optional<CoordinateSystem>& crs);

/// Gives a stream the rows and the view point of the file that its points come from.
/// @param same_order  the points are in the file's order, some perhaps left out
std::unique_ptr<PointSource> with_layout(std::unique_ptr<PointSource> source,
                                         const PointStreamHeader& header, bool same_order);

/// Sets the ASPRS class of ground points to 2, and to 1 where a point was 0 or 2 and is no ground;
/// other classes stay. Adds the attribute "classification" where it is not there.
/// @param ground 1 for ground, 0 for none, -1 for points whose class is left as it is; one a point.
std::unique_ptr<PointSource> classify_ground(std::unique_ptr<PointSource> source,
                                             const std::vector<int>& ground);

/// Opens a file like open_point_source. The columns of a text file whose values are all whole
/// numbers of 32 bits get an integer type, and colours whose type leaves open what is full a
/// `full_color`, which takes a first pass over the file.
/// @param output  the format in which the points will be written: PLY and PCD, whose colours are
///                bytes, ask for the `full_color` of 16 bits, too, which may hold no more than
///                bytes; PCD for the `bounds` of doubles, LAS for those of angles.
std::unique_ptr<PointSource> open_typed_source(const std::filesystem::path& path,
                                               const ReadOptions& options = {},
                                               std::optional<CloudFormat> output = {});

/// Writes all points of a source to a file, atomically, in constant memory (but for a compressed
/// PCD, whose format needs all at once). From LAS to LAS records, header, variable-length records
/// and what stands behind the points stay as they are but for what changed.
/// @param notes if given, gets what a user should know about the output, one sentence each
/// @return number of points. @throws as write_cloud.
std::uint64_t write_points(PointSource& source, const std::filesystem::path& path,
                           const WriteOptions& options = {}, const Progress& progress = {},
                           std::vector<std::string>* notes = nullptr);

/// Copies a cloud file with one more integer attribute, all others unchanged as far as the format
/// has their types: `values` are those of its points in their order. @throws InputError,
/// OutputError, std::invalid_argument.
/// @param notes as those of write_points
void write_labelled_copy(const std::filesystem::path& input, const ReadOptions& read_options,
                         const std::string& name, const std::vector<int>& values,
                         const std::filesystem::path& output,
                         const WriteOptions& write_options = {},
                         std::vector<std::string>* notes = nullptr);

}  // namespace camber
