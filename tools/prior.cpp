// camber prior: shape priors of vehicles, learnt and measured.

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>

#include "camber/core/atomic_file.h"
#include "camber/core/errors.h"
#include "camber/core/stopwatch.h"
#include "camber/core/version.h"
#include "camber/render/keypoint_picture.h"
#include "camber/scene/results.h"
#include "camber/synth/family_prior.h"
#include "camber/vehicle/annotated_shapes.h"
#include "command.h"

namespace camber::tools {
namespace {

struct LearnArguments {
  std::string shapes, out, name = "car";
  bool family = false, json = false;
  int coefficients = 20;
};

struct InfoArguments {
  std::string prior, against, picture;
  bool json = false;
};

struct Residuals {
  double mean = 0.0, p95 = 0.0;  // m, over all keypoints of all shapes
};

Residuals residuals_of(const ShapePrior& prior, const std::vector<AnnotatedShape>& shapes,
                       int coefficients) {
  std::vector<double> all;
  for (const AnnotatedShape& shape : shapes) {
    const ShapeExplanation e = explain_shape(prior, shape, coefficients);
    all.insert(all.end(), e.residuals.data(), e.residuals.data() + e.residuals.size());
  }
  Residuals out;
  for (const double r : all) out.mean += r / static_cast<double>(all.size());
  const auto at = all.begin() + static_cast<std::ptrdiff_t>(0.95 * (all.size() - 1));
  std::nth_element(all.begin(), at, all.end());
  out.p95 = *at;
  return out;
}

/// @throws InputError where most shapes are gross errors: their axes are others, not their cars.
AnnotatedPrior learn(const std::string& name, const std::vector<AnnotatedShape>& shapes,
                     const ShapePrior& reference, int coefficients, const std::string& file) {
  std::size_t reversed = 0;
  for (const AnnotatedShape& shape : shapes) {
    reversed += explain_shape(reference, shape, 0).scale.minCoeff() <= 0.0 ? 1 : 0;
  }
  const auto check = [&](std::size_t wrong) {
    if (2 * wrong <= shapes.size()) return;
    throw InputError(file, fmt::format("found {} of {} shapes that are no {}, expected axes to the "
                                       "front, up and right, and keypoints in the order of "
                                       "docs/keypoints.md",
                                       wrong, shapes.size(), reference.name));
  };
  check(reversed);
  AnnotatedPrior out = learn_annotated_prior(name, shapes, reference, nullptr, {coefficients});
  check(out.outliers.size());
  return out;
}

void add_timings(const Timings& timings, nlohmann::json* json) {
  for (const auto& [stage, milliseconds] : timings.stages()) {
    (*json)["timings_ms"][stage] = milliseconds;
  }
}

nlohmann::json describe_shape(const ShapePrior& shape) {
  const auto& c = shape.parameters_covariance;
  const Eigen::Vector3d sigma = c.topLeftCorner<3, 3>().diagonal().cwiseSqrt();
  std::vector<double> left;
  for (int k = 0; k <= shape.num_coefficients(); ++k) {
    left.push_back(std::sqrt(shape.residual_sigma(k).squaredNorm() / kNumSideKeypoints));
  }
  return {{"name", shape.name},
          {"samples", shape.samples},
          {"coefficients", shape.num_coefficients()},
          {"dimensions",
           {{"length", shape.parameters_mean[0]},
            {"width", shape.parameters_mean[1]},
            {"height", shape.parameters_mean[2]}}},
          {"dimensions_sigma", {{"length", sigma[0]}, {"width", sigma[1]}, {"height", sigma[2]}}},
          {"correlation",
           {{"length_width", c(0, 1) / (sigma[0] * sigma[1])},
            {"length_height", c(0, 2) / (sigma[0] * sigma[2])},
            {"width_height", c(1, 2) / (sigma[1] * sigma[2])}}},
          {"wheel_radius", shape.mean(1, 0) * shape.parameters_mean[2]},
          {"keypoint_sigma_by_coefficients", left}};
}

int learn(const Command& command, const LearnArguments& args) {
  if (args.family == !args.shapes.empty()) {
    throw UsageError("prior learn: expected either a CSV file or --family");
  }
  check_output_file(args.out);
  Timings timings;
  VehiclePrior prior;
  nlohmann::json json = {{"version", kVersion}, {"seed", command.common.seed}};
  if (args.family) {
    const StageTimer timer(timings, "compute");
    FamilyPriorOptions options;
    options.seed = command.common.seed;
    options.num_coefficients = args.coefficients;
    prior = learn_family_prior(options);
  } else {
    std::vector<AnnotatedShape> shapes;
    {
      const StageTimer timer(timings, "load");
      shapes = read_annotated_shapes(args.shapes);
    }
    const StageTimer timer(timings, "compute");
    if (shapes.size() < 3) {
      throw NoAnswerError(args.shapes + ": " + std::to_string(shapes.size()) +
                          " shapes, at least 3 are needed");
    }
    prior = shipped_vehicle_prior();
    const ShapePrior& reference = shipped_vehicle_prior().shape(args.name);
    AnnotatedPrior learnt = learn(args.name, shapes, reference, args.coefficients, args.shapes);
    json["outliers"] = nlohmann::json::array();
    for (const int i : learnt.outliers) json["outliers"].push_back(shapes[i].name);
    prior.source = "annotated shapes, " + std::filesystem::path(args.shapes).filename().string();
    for (ShapePrior& shape : prior.shapes) {
      if (shape.name == reference.name) shape = learnt.prior;
    }
  }
  {
    const StageTimer timer(timings, "write");
    write_vehicle_prior(prior, args.out);
  }
  json["options"] = {{"family", args.family},
                     {"shapes", args.shapes},
                     {"name", args.name},
                     {"coefficients", args.coefficients}};
  for (const ShapePrior& shape : prior.shapes) json["shapes"].push_back(describe_shape(shape));
  if (args.json) {
    add_timings(timings, &json);
    std::printf("%s\n", json.dump(2).c_str());
  } else if (!command.common.quiet) {
    std::printf("%s: %s\n", args.out.c_str(), prior.source.c_str());
    if (json.contains("outliers")) {
      std::printf("%zu gross errors left out\n", json["outliers"].size());
      for (const auto& name : json["outliers"]) {
        std::printf("  %s\n", name.get<std::string>().c_str());
      }
    }
  }
  return 0;
}

int info(const Command& command, const InfoArguments& args) {
  check_output_file(args.picture);
  require_png("--picture", args.picture);
  Timings timings;
  VehiclePrior prior;
  std::vector<AnnotatedShape> shapes;
  {
    const StageTimer timer(timings, "load");
    prior = args.prior.empty() ? shipped_vehicle_prior() : read_vehicle_prior(args.prior);
    if (!args.against.empty()) shapes = read_annotated_shapes(args.against);
  }
  if (!args.picture.empty()) {
    const StageTimer timer(timings, "write");
    write_png(draw_keypoint_picture(prior.shapes.front()), args.picture);
  }
  nlohmann::json json = {
      {"version", kVersion},
      {"seed", command.common.seed},
      {"options", {{"prior", args.prior}, {"against", args.against}, {"picture", args.picture}}},
      {"source", prior.source}};
  for (const ShapePrior& shape : prior.shapes) json["shapes"].push_back(describe_shape(shape));
  for (const SizePrior& size : prior.sizes) {
    const Eigen::Vector3d sigma = size.covariance.diagonal().cwiseSqrt();
    json["sizes"].push_back({{"name", size.name},
                             {"dimensions", {size.mean[0], size.mean[1], size.mean[2]}},
                             {"sigma", {sigma[0], sigma[1], sigma[2]}}});
  }
  if (!shapes.empty()) {
    const StageTimer timer(timings, "compute");
    if (shapes.size() < 6) {
      throw NoAnswerError(args.against + ": " + std::to_string(shapes.size()) +
                          " shapes, at least 6 are needed");
    }
    // One half teaches a prior of the annotation's own; both are measured on the other half.
    std::vector<AnnotatedShape> half, others;
    for (std::size_t i = 0; i < shapes.size(); ++i) {
      (i % 2 ? half : others).push_back(shapes[i]);
    }
    const ShapePrior& car = prior.shapes.front();
    const ShapePrior own = learn("half", half, car, car.num_coefficients(), args.against).prior;
    json["against"] = {{"shapes", shapes.size()}, {"rows", nlohmann::json::array()}};
    for (const int count : {0, 5, 10, 20}) {
      if (count > car.num_coefficients() || count > own.num_coefficients()) continue;
      const Residuals all = residuals_of(car, shapes, count);
      const Residuals ours = residuals_of(car, others, count);
      const Residuals theirs = residuals_of(own, others, count);
      json["against"]["rows"].push_back({{"coefficients", count},
                                         {"mean_residual", all.mean},
                                         {"p95_residual", all.p95},
                                         {"half_mean_residual", ours.mean},
                                         {"half_p95_residual", ours.p95},
                                         {"own_prior_mean_residual", theirs.mean},
                                         {"own_prior_p95_residual", theirs.p95},
                                         {"ratio", ours.mean / theirs.mean}});
    }
  }
  if (args.json) {
    add_timings(timings, &json);
    std::printf("%s\n", json.dump(2).c_str());
    return 0;
  }
  std::printf("%s\n", prior.source.c_str());
  for (const auto& s : json["shapes"]) {
    const auto& d = s["dimensions"];
    const auto& sigma = s["dimensions_sigma"];
    std::printf(
        "%-12s %.2f +- %.2f x %.2f +- %.2f x %.2f +- %.2f m, wheel radius %.3f m, %d "
        "coefficients\n",
        s["name"].get<std::string>().c_str(), d["length"].get<double>(),
        sigma["length"].get<double>(), d["width"].get<double>(), sigma["width"].get<double>(),
        d["height"].get<double>(), sigma["height"].get<double>(), s["wheel_radius"].get<double>(),
        s["coefficients"].get<int>());
  }
  for (const SizePrior& size : prior.sizes) {
    const Eigen::Vector3d sigma = size.covariance.diagonal().cwiseSqrt();
    std::printf("%-12s %.2f +- %.2f x %.2f +- %.2f x %.2f +- %.2f m, size only\n",
                size.name.c_str(), size.mean[0], sigma[0], size.mean[1], sigma[1], size.mean[2],
                sigma[2]);
  }
  if (json.contains("against")) {
    std::printf("against %zu annotated shapes, keypoint residual in m at the prior's mean size:\n",
                shapes.size());
    std::printf(
        "coefficients   mean    p95   | on one half: this prior, one learnt on the other "
        "half, ratio\n");
    for (const auto& r : json["against"]["rows"]) {
      std::printf("%12d  %.3f  %.3f   | %.3f  %.3f  %.2f\n", r["coefficients"].get<int>(),
                  r["mean_residual"].get<double>(), r["p95_residual"].get<double>(),
                  r["half_mean_residual"].get<double>(), r["own_prior_mean_residual"].get<double>(),
                  r["ratio"].get<double>());
    }
  }
  return 0;
}

}  // namespace

void register_prior(App& root) {
  App* prior = root.add_subcommand("prior", "Shape and size priors of vehicles");
  prior->require_subcommand();

  Command* learn_command = add_command(
      *prior, "learn",
      "Learns a prior: from annotated shapes (CSV: name, then 36 keypoints x, y, z a row; axes to "
      "the front, up, right; any scale) with the shipped prior's metric sizes, or from the "
      "parametric car family, which makes the prior that ships.",
      "  camber prior learn --family --out lib/camber/vehicle/shipped_prior.json\n"
      "  camber prior learn annotated_shapes.csv --out my_prior.json");
  // The shipped prior is that of the family's default seed.
  learn_command->common.seed = FamilyPriorOptions().seed;
  learn_command->seed->capture_default_str();
  auto l = std::make_shared<LearnArguments>();
  learn_command->app->add_option("shapes", l->shapes, "annotated shapes, CSV");
  learn_command->app->add_flag("--family", l->family, "learn from the parametric car family");
  learn_command->app->add_option("--out", l->out, "prior file (JSON)")->output_file()->required();
  learn_command->app->add_option("--name", l->name, "class of the annotated shapes: car or van")
      ->check(is_member({"car", "van"}))
      ->capture_default_str();
  learn_command->app->add_option("--coefficients", l->coefficients, "principal components to keep")
      ->check(in_range(0, 20))
      ->capture_default_str();
  learn_command->app->add_flag("--json", l->json, "print what was learnt as JSON");
  learn_command->run = [learn_command, l] { return learn(*learn_command, *l); };

  Command* info_command = add_command(
      *prior, "info",
      "Sizes and shapes of a prior; with --against also how well its shapes explain annotated "
      "ones, compared with a prior learnt on half of those.",
      "  camber prior info --picture keypoints.png\n"
      "  camber prior info my_prior.json --against annotated_shapes.csv --json");
  auto i = std::make_shared<InfoArguments>();
  info_command->app->add_option("prior", i->prior, "prior file; default: the shipped one");
  info_command->app->add_option("--against", i->against, "annotated shapes, CSV");
  info_command->app
      ->add_option("--picture", i->picture, "FILE.png: the first shape with its numbered keypoints")
      ->output_file();
  info_command->app->add_flag("--json", i->json, "print as JSON");
  info_command->run = [info_command, i] { return info(*info_command, *i); };
}

}  // namespace camber::tools
