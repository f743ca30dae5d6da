// filter, convert and profile_cloud.

#include <fmt/format.h>

#include <cmath>
#include <memory>
#include <string>
#include <utility>

#include "camber/cloud/cloud_io.h"
#include "camber/cloud/filters.h"
#include "camber/cloud/morton.h"
#include "camber/cloud/normals.h"
#include "camber/cloud/point_selection.h"
#include "camber/cloud/stream_filters.h"
#include "camber/cloud/voxel_grid.h"
#include "camber/core/errors.h"
#include "camber/core/interruption.h"
#include "camber/road/cloud_profile.h"
#include "convert.h"
#include "running.h"

namespace fs = std::filesystem;

namespace camber::python {
namespace {

struct Filter {
  std::vector<int> classes, without_classes;
  std::string returns;
  std::optional<std::vector<double>> box;
  bool outside = false;
  double range = 0.0;
  bool drop_non_finite = false;
  double voxel = 0.0;
  std::optional<std::pair<double, int>> radius;
  std::optional<std::pair<int, double>> statistical;
  int normals = 0;
  std::optional<Eigen::Vector3d> up, viewpoint;
  bool morton = false;
  int threads = 0;
};

std::unique_ptr<PointSource> selected(std::unique_ptr<PointSource> source, const Filter& f) {
  PointSelection selection;
  selection.classes = f.classes;
  selection.without_classes = f.without_classes;
  if (f.returns == "first") selection.returns = PointSelection::Returns::kFirst;
  if (f.returns == "last") selection.returns = PointSelection::Returns::kLast;
  if (f.returns == "single") selection.returns = PointSelection::Returns::kSingle;
  if (!selection.selects()) return source;
  return select_points(std::move(source), selection, "the cloud");
}

std::unique_ptr<PointSource> cropped(std::unique_ptr<PointSource> source, const Filter& f) {
  if (!f.drop_non_finite && !f.box && !(f.range > 0.0)) return source;
  CropBox box;
  if (f.box) {
    const std::vector<double>& b = *f.box;
    if (b.size() != 6 || !(b[0] <= b[3] && b[1] <= b[4] && b[2] <= b[5])) {
      throw std::invalid_argument("box: expected 6 numbers: least x, y, z, greatest x, y, z");
    }
    box.minimum = {b[0], b[1], b[2]};
    box.maximum = {b[3], b[4], b[5]};
  }
  return select_points(std::move(source), [box, f](const Eigen::Vector3d& x) {
    return x.allFinite() && (!f.box || box.contains(x) != f.outside) &&
           (f.range <= 0.0 || x.norm() <= f.range);
  });
}

RoadCloud collected(PointSource& source) {
  CloudBuilder builder(source.header(), false);
  PointBatch batch;
  while (source.next(batch)) {
    builder.add(batch);
    throw_if_interrupted();
  }
  ReadReport report;
  return builder.finish(report);
}

/// The steps of camber filter, in its order.
RoadCloud filtered(const RoadCloud& given, const Filter& f) {
  std::unique_ptr<PointSource> source = cropped(selected(make_point_source(given), f), f);
  std::unique_ptr<VoxelGrid> grid;
  std::unique_ptr<PointSource> input;
  if (f.voxel > 0.0) {
    grid = std::make_unique<VoxelGrid>(source->header(), f.voxel);
    PointBatch batch;
    while (source->next(batch)) {
      grid->add(batch);
      throw_if_interrupted();
    }
    input = std::move(source);
    source = grid->points();
  }
  RoadCloud cloud = collected(*source);
  if (f.radius) {
    cloud = cloud.select(radius_inliers(cloud, f.radius->first, f.radius->second, f.threads));
  }
  if (f.statistical) {
    cloud = cloud.select(
        statistical_inliers(cloud, f.statistical->first, f.statistical->second, f.threads));
  }
  if (f.normals > 0) {
    NormalOptions options;
    options.neighbors = f.normals;
    options.num_threads = f.threads;
    options.up = f.up.value_or(cloud.default_up());
    if (f.viewpoint) options.viewpoint = *f.viewpoint;
    estimate_normals(cloud, options);
  }
  if (f.morton) cloud = cloud.select(morton_order(cloud.points));
  return cloud;
}

void bind_filter(py::module_& module) {
  module.def(
      "filter",
      [](const py::object& cloud, const std::vector<int>& classes,
         const std::vector<int>& without_classes, const std::string& returns,
         const std::optional<std::vector<double>>& box, bool outside, double range,
         bool drop_non_finite, double voxel, const std::optional<std::pair<double, int>>& radius,
         const std::optional<std::pair<int, double>>& statistical, int normals,
         const std::optional<Eigen::Vector3d>& up, const std::optional<Eigen::Vector3d>& viewpoint,
         bool morton, int threads) {
        if (!returns.empty() && returns != "first" && returns != "last" && returns != "single") {
          throw std::invalid_argument("returns: found '" + returns +
                                      "', expected 'first', 'last' or 'single'");
        }
        if (!(range >= 0.0) || !(voxel >= 0.0)) {
          throw std::invalid_argument("range, voxel: expected metres of at least 0");
        }
        const CloudArgument argument(cloud, "cloud");
        const Filter f = {classes,         without_classes, returns, box,         outside, range,
                          drop_non_finite, voxel,           radius,  statistical, normals, up,
                          viewpoint,       morton,          threads};
        return compute([&] { return filtered(*argument.cloud, f); });
      },
      py::arg("cloud"), py::kw_only(), py::arg("classes") = std::vector<int>(),
      py::arg("without_classes") = std::vector<int>(), py::arg("returns") = "",
      py::arg("box") = py::none(), py::arg("outside") = false, py::arg("range") = 0.0,
      py::arg("drop_non_finite") = false, py::arg("voxel") = 0.0, py::arg("radius") = py::none(),
      py::arg("statistical") = py::none(), py::arg("normals") = 0, py::arg("up") = py::none(),
      py::arg("viewpoint") = py::none(), py::arg("morton") = false, py::arg("threads") = 0,
      with_keywords("What is left of a cloud, step by step as camber filter does it.",
                    {{"classes", "ASPRS classes to keep; none: all"},
                     {"without_classes", "classes to drop"},
                     {"returns", "'first', 'last' or 'single'; '': all"},
                     {"box", "least x, y, z and greatest x, y, z, m: its inside stays"},
                     {"outside", "the outside of the box, instead"},
                     {"range", "m from the origin of coordinates; 0: any"},
                     {"drop_non_finite", "drops NaN and infinite coordinates"},
                     {"voxel", "m, one point for each cube of this edge; 0: all points"},
                     {"radius", "(R, N): drops points with fewer than N others within R m"},
                     {"statistical",
                      "(K, S): drops points whose mean distance to K neighbours is more than "
                      "S standard deviations above the mean"},
                     {"normals", "estimates normals from so many nearest points; 0: none"},
                     {"up", "normals point to this side; None: the cloud's default_up"},
                     {"viewpoint", "normals point to this place, instead"},
                     {"morton", "sorts along a Z curve"}})
          .c_str());
}

CloudEncoding encoding_of(const std::string& name) {
  if (name == "ascii") return CloudEncoding::kAscii;
  if (name == "big-endian") return CloudEncoding::kBigEndian;
  if (name == "compressed") return CloudEncoding::kCompressed;
  if (name == "commas") return CloudEncoding::kCommas;
  if (name == "binary") return CloudEncoding::kBinary;
  throw std::invalid_argument("encoding: found '" + name +
                              "', expected 'ascii', 'binary', 'big-endian', 'compressed' or "
                              "'commas'");
}

void bind_convert(py::module_& module) {
  module.def(
      "convert",
      [](const fs::path& input, const fs::path& out, const std::string& encoding,
         const std::vector<std::string>& columns, bool lenient, const py::object& progress) {
        ReadOptions read;
        read.lenient = lenient;
        read.columns = columns;
        WriteOptions write;
        if (!encoding.empty()) write.encoding = encoding_of(encoding);
        if (!format_from_extension(out)) {
          throw std::invalid_argument("out: unknown extension, expected a cloud's");
        }
        const Progress report = to_progress(progress);
        return compute([&] {
          std::unique_ptr<PointSource> source =
              open_typed_source(input, read, format_from_extension(out));
          if (lenient) source = drop_bad_points(std::move(source));
          return write_points(*source, out, write, report);
        });
      },
      py::arg("input"), py::arg("out"), py::kw_only(), py::arg("encoding") = "",
      py::arg("columns") = std::vector<std::string>(), py::arg("lenient") = false,
      py::arg("progress") = py::none(),
      with_keywords("Writes a cloud file in another format, streamed; gives the number of points.",
                    {{"input", "cloud file"},
                     {"out", "cloud file; its extension is the format"},
                     {"encoding", "'ascii', 'binary', 'big-endian', 'compressed' or 'commas'"},
                     {"columns", "names of the columns of a text or .bin file"},
                     {"lenient", "leaves out points that are no numbers"}})
          .c_str());
}

GroundSource ground_source(const std::string& name) {
  if (name == "auto") return GroundSource::kAuto;
  if (name == "class") return GroundSource::kClasses;
  if (name == "label") return GroundSource::kLabels;
  if (name == "compute") return GroundSource::kCompute;
  if (name == "all") return GroundSource::kAll;
  throw std::invalid_argument("ground_from: found '" + name +
                              "', expected 'auto', 'class', 'label', 'compute' or 'all'");
}

void bind_cloud_profile(py::module_& module) {
  py::class_<CrossSection, ProfilePoint>(module, "CrossSection", kDoc_CrossSection)
      .CAMBER_FIELD(CrossSection, width_left)
      .CAMBER_FIELD(CrossSection, width_right)
      .CAMBER_FIELD(CrossSection, crest)
      .CAMBER_FIELD(CrossSection, cross_slope_left)
      .CAMBER_FIELD(CrossSection, cross_slope_right)
      .CAMBER_FIELD(CrossSection, points)
      .def_property_readonly(
          "offsets",
          [](const py::object& self) { return view_of(self.cast<CrossSection&>().offsets, self); },
          CAMBER_DOC(CrossSection, offsets))
      .def_property_readonly(
          "heights",
          [](const py::object& self) { return view_of(self.cast<CrossSection&>().heights, self); },
          CAMBER_DOC(CrossSection, heights));
  const CloudProfileOptions defaults;
  module.def(
      "profile_cloud",
      [](const py::object& cloud, const py::object& line, double half_width, bool crown,
         const std::string& ground_from, const std::optional<Eigen::Vector3d>& up, double step,
         double length, double levelling_sigma, double drift_sigma, int threads) {
        const CloudArgument argument(cloud, "cloud");
        const std::vector<Eigen::Vector3d> places = to_points(line, "line");
        CloudProfileOptions options;
        options.half_width = half_width;
        options.crown = crown;
        options.profile.step = step;
        options.profile.length = length;
        options.profile.levelling_sigma = levelling_sigma;
        options.profile.drift_sigma = drift_sigma;
        options.num_threads = threads;
        options.validate();
        const GroundSource source = ground_source(ground_from);
        const Eigen::Vector3d level = up.value_or(argument.cloud->default_up());
        CloudProfile found = compute([&] {
          const GroundBesideLine ground =
              ground_beside_line(*argument.cloud, level, places, half_width, source, threads);
          if (ground.status == Status::kFailed) throw NoAnswerError(ground.reason);
          CloudProfile profile =
              profile_cloud(*argument.cloud, ground.points, level, places, options);
          if (profile.status == Status::kFailed) throw NoAnswerError(profile.reason);
          return profile;
        });
        return std::move(found.stations);
      },
      py::arg("cloud"), py::arg("line"), py::kw_only(), py::arg("half_width") = defaults.half_width,
      py::arg("crown") = defaults.crown, py::arg("ground_from") = "auto",
      py::arg("up") = py::none(), py::arg("step") = defaults.profile.step,
      py::arg("length") = defaults.profile.length,
      py::arg("levelling_sigma") = defaults.profile.levelling_sigma,
      py::arg("drift_sigma") = defaults.profile.drift_sigma, py::arg("threads") = 0,
      with_keywords(kDoc_profile_cloud,
                    {{"cloud", "in metres"},
                     {"line", "N x 3, m, in the cloud's frame"},
                     {"half_width", CAMBER_DOC(CloudProfileOptions, half_width)},
                     {"crown", CAMBER_DOC(CloudProfileOptions, crown)},
                     {"ground_from", "'auto', 'class', 'label', 'compute' or 'all'"},
                     {"up", "in the cloud's frame; None: the cloud's default_up"},
                     {"step", CAMBER_DOC(ProfileOptions, step)},
                     {"length", CAMBER_DOC(ProfileOptions, length)},
                     {"levelling_sigma", CAMBER_DOC(ProfileOptions, levelling_sigma)},
                     {"drift_sigma", CAMBER_DOC(ProfileOptions, drift_sigma)}})
          .c_str());
}

}  // namespace

void bind_cloud_work(py::module_& module) {
  bind_filter(module);
  bind_convert(module);
  bind_cloud_profile(module);
}

}  // namespace camber::python
