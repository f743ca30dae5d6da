#include "camber/vehicle/shape_prior.h"

#include <fmt/format.h>

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <fstream>
#include <iterator>
#include <nlohmann/json.hpp>
#include <stdexcept>

#include "camber/core/atomic_file.h"
#include "camber/core/errors.h"
#include "camber/core/lower_case.h"
#include "camber/vehicle/detail/shipped_prior.h"

namespace camber {

namespace {

using SideMatrix = Eigen::Matrix<double, 3, kNumSideKeypoints>;
constexpr int kSideNumbers = 3 * kNumSideKeypoints;

SizePrior make_size(const char* name, const Eigen::Vector3d& mean, const Eigen::Vector3d& sigma,
                    double length_width, double length_height, double width_height) {
  Eigen::Matrix3d correlation;
  correlation << 1.0, length_width, length_height, length_width, 1.0, width_height, length_height,
      width_height, 1.0;
  return {name, mean, sigma.asDiagonal() * correlation * sigma.asDiagonal()};
}

/// Nine significant digits as JSON numbers.
std::string number_list(const double* values, std::size_t count) {
  std::string out = "[";
  for (std::size_t i = 0; i < count; ++i) {
    if (i > 0) out += i % 9 == 0 ? ",\n        " : ", ";
    // Below 1e-12 there is only rounding noise.
    out += std::abs(values[i]) < 1e-12 ? std::string("0") : fmt::format("{:.9g}", values[i]);
  }
  return out + "]";
}

/// A member of a JSON document with the path for messages.
class Reader {
 public:
  Reader(const nlohmann::json& value, const std::string& file, std::string path)
      : value_(&value), file_(&file), path_(std::move(path)) {}

  [[noreturn]] void fail(const std::string& expectation) const {
    std::string found = value_->is_array() ? fmt::format("an array of {}", value_->size())
                                           : std::string(value_->type_name());
    throw InputError(*file_, path_.empty() ? "top level" : path_,
                     "found " + found + ", expected " + expectation);
  }

  Reader member(const char* key) const {
    if (!value_->is_object()) fail("an object");
    const auto it = value_->find(key);
    if (it == value_->end()) {
      throw InputError(*file_, path_.empty() ? "top level" : path_,
                       fmt::format("found no \"{}\", expected one", key));
    }
    return {*it, *file_, path_.empty() ? key : path_ + "." + key};
  }

  std::vector<Reader> elements() const {
    if (!value_->is_array()) fail("an array");
    std::vector<Reader> out;
    for (std::size_t i = 0; i < value_->size(); ++i) {
      out.emplace_back((*value_)[i], *file_, fmt::format("{}[{}]", path_, i));
    }
    return out;
  }

  std::string text() const {
    if (!value_->is_string()) fail("a string");
    return value_->get<std::string>();
  }

  /// All numbers of a prior but counts are of the order of metres.
  double number(double largest = 1e6) const {
    if (!value_->is_number()) fail("a number");
    const double x = value_->get<double>();
    if (!(std::abs(x) <= largest)) {
      throw InputError(*file_, path_,
                       fmt::format("found {}, expected a number of at most {:g}", x, largest));
    }
    return x;
  }

  std::vector<double> numbers(std::size_t count) const {
    if (!value_->is_array() || value_->size() != count) fail(fmt::format("{} numbers", count));
    std::vector<double> out;
    for (const Reader& r : elements()) out.push_back(r.number());
    return out;
  }

  SideMatrix side() const {
    const std::vector<double> n = numbers(kSideNumbers);
    return Eigen::Map<const SideMatrix>(n.data());
  }

  Eigen::MatrixXd covariance(int size) const {
    const std::vector<double> n = numbers(static_cast<std::size_t>(size) * size);
    Eigen::MatrixXd m = Eigen::Map<const Eigen::MatrixXd>(n.data(), size, size);
    if ((m - m.transpose()).cwiseAbs().maxCoeff() > 1e-6 * m.cwiseAbs().maxCoeff()) {
      fail("a symmetric matrix");
    }
    const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> solver(m, Eigen::EigenvaluesOnly);
    if (!(solver.eigenvalues().minCoeff() > 0.0)) fail("a positive definite matrix");
    return 0.5 * (m + m.transpose());
  }

 private:
  const nlohmann::json* value_;
  const std::string* file_;
  std::string path_;
};

}  // namespace

KeypointMatrix ShapePrior::keypoints(const Dimensions& dimensions,
                                     const std::vector<double>& coefficients) const {
  if (coefficients.size() > basis.size()) {
    throw std::invalid_argument(fmt::format("shape coefficients: {} given, the prior has {}",
                                            coefficients.size(), basis.size()));
  }
  SideMatrix side = mean;
  for (std::size_t k = 0; k < coefficients.size(); ++k) side += coefficients[k] * basis[k];
  const Eigen::Vector3d size(dimensions.length, dimensions.height, dimensions.width);
  KeypointMatrix out;
  out.leftCols<kNumSideKeypoints>() = size.asDiagonal() * side;
  out.rightCols<kNumSideKeypoints>() = out.leftCols<kNumSideKeypoints>();
  out.rightCols<kNumSideKeypoints>().row(2) *= -1.0;
  return out;
}

SideMatrix ShapePrior::residual_sigma(int count) const {
  const Eigen::Vector3d size(parameters_mean[0], parameters_mean[2], parameters_mean[1]);
  SideMatrix variance = sigma.cwiseAbs2();
  for (int k = 0; k < std::min(count, num_coefficients()); ++k) {
    variance -= (size.asDiagonal() * basis[k]).cwiseAbs2();
  }
  return variance.cwiseMax(0.0).cwiseSqrt();
}

ShapePrior ShapePrior::truncated(int count) const {
  const int retained = std::min(std::max(count, 0), num_coefficients());
  ShapePrior out = *this;
  out.basis.resize(retained);
  out.parameters_mean = parameters_mean.head(3 + retained).eval();
  out.parameters_covariance =
      parameters_covariance.topLeftCorner(3 + retained, 3 + retained).eval();
  return out;
}

const ShapePrior& VehiclePrior::shape(const std::string& vehicle_class) const {
  const std::string wanted = lower_case(vehicle_class);
  for (const ShapePrior& s : shapes) {
    if (s.name == wanted) return s;
  }
  return shapes.front();
}

bool VehiclePrior::has_shape(const std::string& vehicle_class) const {
  const std::string wanted = lower_case(vehicle_class);
  return std::none_of(sizes.begin(), sizes.end(),
                      [&](const SizePrior& s) { return s.name == wanted; });
}

SizePrior VehiclePrior::size(const std::string& vehicle_class) const {
  const std::string wanted = lower_case(vehicle_class);
  for (const SizePrior& s : sizes) {
    if (s.name == wanted) return s;
  }
  const ShapePrior& s = shape(wanted);
  return {s.name, s.parameters_mean.head<3>(), s.parameters_covariance.topLeftCorner<3, 3>()};
}

void ShapeLearningOptions::validate() const {
  if (num_coefficients < 0 || num_coefficients > kSideNumbers) {
    throw std::invalid_argument(
        fmt::format("num_coefficients: {}, must be in [0, {}]", num_coefficients, kSideNumbers));
  }
}

ShapePrior learn_shape_prior(const std::string& name, const std::vector<ShapeSample>& samples,
                             const ShapeLearningOptions& options) {
  options.validate();
  if (samples.size() < 2) {
    throw std::invalid_argument(
        fmt::format("samples: {} given, at least 2 are needed", samples.size()));
  }
  const int n = static_cast<int>(samples.size());
  Eigen::MatrixXd shares(kSideNumbers, n), sizes(3, n);
  for (int i = 0; i < n; ++i) {
    const Dimensions& d = samples[i].dimensions;
    if (!(d.length > 0.0 && d.width > 0.0 && d.height > 0.0)) {
      throw std::invalid_argument(fmt::format("samples[{}].dimensions: not positive", i));
    }
    SideMatrix right = samples[i].keypoints.rightCols<kNumSideKeypoints>();
    right.row(2) *= -1.0;
    const SideMatrix side = 0.5 * (samples[i].keypoints.leftCols<kNumSideKeypoints>() + right);
    const SideMatrix share =
        Eigen::Vector3d(d.length, d.height, d.width).cwiseInverse().asDiagonal() * side;
    shares.col(i) = Eigen::Map<const Eigen::VectorXd>(share.data(), kSideNumbers);
    sizes.col(i) = Eigen::Vector3d(d.length, d.width, d.height);
  }
  const Eigen::VectorXd share_mean = shares.rowwise().mean();
  const Eigen::Vector3d size_mean = sizes.rowwise().mean();

  // Principal components in metres at the mean size.
  Eigen::VectorXd metres(kSideNumbers);
  for (int i = 0; i < kNumSideKeypoints; ++i) {
    metres.segment<3>(3 * i) = Eigen::Vector3d(size_mean[0], size_mean[2], size_mean[1]);
  }
  const Eigen::MatrixXd centred = metres.asDiagonal() * (shares.colwise() - share_mean);
  const Eigen::MatrixXd scatter = centred * centred.transpose() / (n - 1.0);
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> solver(scatter);
  const Eigen::VectorXd eigenvalues = solver.eigenvalues().reverse().cwiseMax(0.0);
  int retained = 0;
  while (retained < options.num_coefficients && eigenvalues[retained] > 1e-10 * eigenvalues[0] &&
         eigenvalues[retained] > 0.0) {
    ++retained;
  }

  ShapePrior out;
  out.name = name;
  out.samples = n;
  out.mean = Eigen::Map<const SideMatrix>(share_mean.data());
  Eigen::MatrixXd parameters(3 + retained, n);
  parameters.topRows<3>() = sizes.colwise() - size_mean;
  for (int k = 0; k < retained; ++k) {
    Eigen::VectorXd direction = solver.eigenvectors().col(kSideNumbers - 1 - k);
    Eigen::Index largest = 0;
    direction.cwiseAbs().maxCoeff(&largest);
    if (direction[largest] < 0.0) direction = -direction;
    const double sigma = std::sqrt(eigenvalues[k]);
    const Eigen::VectorXd share = sigma * metres.cwiseInverse().cwiseProduct(direction);
    out.basis.push_back(Eigen::Map<const SideMatrix>(share.data()));
    parameters.row(3 + k) = direction.transpose() * centred / sigma;
  }
  const Eigen::VectorXd sigma = scatter.diagonal().cwiseMax(0.0).cwiseSqrt();
  out.sigma = Eigen::Map<const SideMatrix>(sigma.data());
  out.parameters_mean = Eigen::VectorXd::Zero(3 + retained);
  out.parameters_mean.head<3>() = size_mean;
  out.parameters_covariance = parameters * parameters.transpose() / (n - 1.0);
  // Few samples may leave it singular; a hundredth of each variance keeps it invertible.
  if (n < 4 * (3 + retained)) {
    out.parameters_covariance.diagonal() *= 1.01;
  }
  return out;
}

std::vector<SizePrior> published_sizes() {
  return {
      make_size("truck", {8.5, 2.50, 3.30}, {2.2, 0.10, 0.45}, 0.6, 0.6, 0.6),
      make_size("bus", {12.0, 2.54, 3.15}, {1.6, 0.04, 0.20}, 0.4, 0.2, 0.2),
      make_size("tram", {20.0, 2.45, 3.45}, {8.0, 0.15, 0.15}, 0.3, 0.1, 0.1),
      make_size("motorcycle", {2.15, 0.80, 1.55}, {0.20, 0.12, 0.18}, 0.2, 0.1, 0.1),
      make_size("cyclist", {1.75, 0.60, 1.75}, {0.15, 0.10, 0.12}, 0.1, 0.2, 0.1),
      make_size("pedestrian", {0.80, 0.60, 1.73}, {0.20, 0.12, 0.12}, 0.2, 0.1, 0.2),
  };
}

const VehiclePrior& shipped_vehicle_prior() {
  static const VehiclePrior prior = parse_vehicle_prior(kShippedPriorText, "shipped_prior.json");
  return prior;
}

std::string vehicle_prior_text(const VehiclePrior& prior) {
  std::string out = "{\n  \"format\": \"camber-prior\",\n  \"version\": 1,\n";
  out += "  \"source\": " + nlohmann::json(prior.source).dump() + ",\n  \"shapes\": [";
  for (std::size_t i = 0; i < prior.shapes.size(); ++i) {
    const ShapePrior& s = prior.shapes[i];
    out += i > 0 ? ",\n    {\n" : "\n    {\n";
    out += "      \"name\": " + nlohmann::json(s.name).dump() + ",\n";
    out += fmt::format("      \"samples\": {},\n", s.samples);
    out += "      \"mean\": " + number_list(s.mean.data(), kSideNumbers) + ",\n";
    out += "      \"basis\": [";
    for (std::size_t k = 0; k < s.basis.size(); ++k) {
      out += (k > 0 ? ",\n        " : "\n        ") + number_list(s.basis[k].data(), kSideNumbers);
    }
    out += "],\n      \"sigma\": " + number_list(s.sigma.data(), kSideNumbers) + ",\n";
    out += "      \"dimensions\": " + number_list(s.parameters_mean.data(), 3) + ",\n";
    out += "      \"covariance\": " +
           number_list(s.parameters_covariance.data(), s.parameters_covariance.size()) + "\n    }";
  }
  out += "\n  ],\n  \"sizes\": [";
  for (std::size_t i = 0; i < prior.sizes.size(); ++i) {
    const SizePrior& s = prior.sizes[i];
    out += i > 0 ? ",\n    {" : "\n    {";
    out += "\"name\": " + nlohmann::json(s.name).dump() +
           ", \"dimensions\": " + number_list(s.mean.data(), 3) +
           ",\n     \"covariance\": " + number_list(s.covariance.data(), 9) + "}";
  }
  return out + "\n  ]\n}\n";
}

VehiclePrior parse_vehicle_prior(const std::string& text, const std::string& name) {
  nlohmann::json json;
  try {
    json = nlohmann::json::parse(text);
  } catch (const nlohmann::json::parse_error& error) {
    throw InputError(name, fmt::format("byte {}", error.byte), "found no JSON, expected a prior");
  } catch (const nlohmann::json::out_of_range&) {
    throw InputError(name, "found a number beyond the range of double, expected a prior");
  }
  const Reader root(json, name, "");
  if (root.member("format").text() != "camber-prior") {
    root.member("format").fail("\"camber-prior\"");
  }
  if (root.member("version").number() != 1.0) root.member("version").fail("version 1");
  VehiclePrior prior;
  prior.source = root.member("source").text();
  for (const Reader& r : root.member("shapes").elements()) {
    ShapePrior s;
    s.name = lower_case(r.member("name").text());
    s.samples = static_cast<int>(r.member("samples").number(1e9));
    s.mean = r.member("mean").side();
    for (const Reader& b : r.member("basis").elements()) s.basis.push_back(b.side());
    const int retained = s.num_coefficients();
    s.sigma = r.member("sigma").side();
    if (!(s.sigma.minCoeff() >= 0.0)) r.member("sigma").fail("54 numbers that are not negative");
    const std::vector<double> size = r.member("dimensions").numbers(3);
    if (!(size[0] > 0.0 && size[1] > 0.0 && size[2] > 0.0)) {
      r.member("dimensions").fail("3 positive numbers");
    }
    s.parameters_mean = Eigen::VectorXd::Zero(3 + retained);
    s.parameters_mean.head<3>() = Eigen::Vector3d(size[0], size[1], size[2]);
    s.parameters_covariance = r.member("covariance").covariance(3 + retained);
    prior.shapes.push_back(std::move(s));
  }
  if (prior.shapes.empty()) root.member("shapes").fail("at least one shape");
  for (const Reader& r : root.member("sizes").elements()) {
    const std::vector<double> size = r.member("dimensions").numbers(3);
    prior.sizes.push_back({lower_case(r.member("name").text()),
                           Eigen::Vector3d(size[0], size[1], size[2]),
                           r.member("covariance").covariance(3)});
  }
  return prior;
}

VehiclePrior read_vehicle_prior(const std::filesystem::path& path) {
  std::ifstream in(path, std::ios::binary);
  if (!in || std::filesystem::is_directory(path)) {
    throw InputError(path.string(), "cannot be read");
  }
  const std::string text{std::istreambuf_iterator<char>(in), std::istreambuf_iterator<char>()};
  return parse_vehicle_prior(text, path.string());
}

void write_vehicle_prior(const VehiclePrior& prior, const std::filesystem::path& path) {
  write_file_atomically(path, vehicle_prior_text(prior));
}

}  // namespace camber
