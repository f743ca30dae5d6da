#include "camber/road/ground_field.h"

#include <Eigen/SparseCholesky>
#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>

namespace camber {
namespace {

struct Footprint {
  int node[4];
  double weight[4];
};

}  // namespace

struct GroundField::Impl {
  PinholeCamera camera;
  double left = 0, top = 0, du = 1, dv = 1;
  int columns = 0, rows = 0;
  Eigen::VectorXd nodes, node_support;
  Eigen::SimplicialLDLT<Eigen::SparseMatrix<double>> solver;
  Eigen::MatrixXd shared;  // d(nodes) / d(shared parameters)
  std::vector<double> weights;

  int index(int r, int c) const { return r * columns + c; }

  Footprint footprint(const Eigen::Vector2d& pixel) const {
    const double x = std::clamp((pixel.x() - left) / du, 0.0, columns - 1.001);
    const double y = std::clamp((pixel.y() - top) / dv, 0.0, rows - 1.001);
    const int c = static_cast<int>(x), r = static_cast<int>(y);
    const double ax = x - c, ay = y - r;
    return {{index(r, c), index(r, c + 1), index(r + 1, c), index(r + 1, c + 1)},
            {(1 - ax) * (1 - ay), ax * (1 - ay), (1 - ax) * ay, ax * ay}};
  }

  double value(const Footprint& f, const Eigen::VectorXd& v) const {
    return f.weight[0] * v[f.node[0]] + f.weight[1] * v[f.node[1]] + f.weight[2] * v[f.node[2]] +
           f.weight[3] * v[f.node[3]];
  }
};

void GroundFieldOptions::validate() const {
  const auto require = [](bool good, const char* name, double value, const char* expected) {
    if (!good) {
      throw std::invalid_argument(std::string(name) + " = " + std::to_string(value) +
                                  ", expected " + expected);
    }
  };
  require(column_spacing_px > 0, "column_spacing_px", column_spacing_px, "> 0");
  require(row_spacing_px > 0, "row_spacing_px", row_spacing_px, "> 0");
  require(along_curvature > 0, "along_curvature", along_curvature, "> 0");
  require(across_curvature > 0, "across_curvature", across_curvature, "> 0");
  require(metres_per_unit > 0, "metres_per_unit", metres_per_unit, "> 0");
  require(correlation >= 1, "correlation", correlation, ">= 1");
  require(iterations >= 1, "iterations", iterations, ">= 1");
}

GroundField::GroundField(const PinholeCamera& camera, const GroundObservations& observations,
                         const GroundFieldOptions& options)
    : impl_(std::make_unique<Impl>()) {
  options.validate();
  const std::size_t count = observations.size();
  if (observations.inverse_depth.size() != count || observations.sigma.size() != count) {
    throw std::invalid_argument("ground observations: arrays differ in length");
  }
  Impl& m = *impl_;
  m.camera = camera;

  // A robust plane to start from: inverse depth linear in the pixel.
  Eigen::Vector3d plane = Eigen::Vector3d::Zero();
  std::vector<double> weight(count, 1.0);
  const auto basis = [&](const Eigen::Vector2d& p) {
    return Eigen::Vector3d((p.x() - camera.cx) / camera.fx, (p.y() - camera.cy) / camera.fy, 1.0);
  };
  for (int iteration = 0; iteration < 10; ++iteration) {
    Eigen::Matrix3d a = Eigen::Matrix3d::Zero();
    Eigen::Vector3d b = Eigen::Vector3d::Zero();
    for (std::size_t i = 0; i < count; ++i) {
      const Eigen::Vector3d x = basis(observations.pixels[i]);
      // In proportion to the depth: the plane's relative error, not the far points', is even.
      const double w = weight[i] / (observations.sigma[i] * observations.sigma[i] +
                                    std::pow(0.05 * observations.inverse_depth[i], 2));
      a += w * x * x.transpose();
      b += w * observations.inverse_depth[i] * x;
    }
    const Eigen::FullPivLU<Eigen::Matrix3d> lu(a);
    if (count < 3 || !lu.isInvertible()) {
      throw std::invalid_argument("ground observations: " + std::to_string(count) +
                                  " points do not fix a plane");
    }
    plane = lu.solve(b);
    for (std::size_t i = 0; i < count; ++i) {
      const double r = observations.inverse_depth[i] - plane.dot(basis(observations.pixels[i]));
      const double s = observations.sigma[i] + 0.05 * std::abs(observations.inverse_depth[i]);
      weight[i] = 1.0 / (1.0 + r * r / (s * s));
    }
  }

  double highest = camera.height;
  for (const Eigen::Vector2d& p : observations.pixels) highest = std::min(highest, p.y());
  m.du = options.column_spacing_px;
  m.dv = options.row_spacing_px;
  m.left = 0.0;
  m.top = highest - m.dv;
  m.columns = std::max(3, static_cast<int>(std::ceil((camera.width - 1) / m.du)) + 1);
  m.rows = std::max(4, static_cast<int>(std::ceil((camera.height - 1 - m.top) / m.dv)) + 1);
  const int n = m.columns * m.rows;
  m.nodes.resize(n);
  for (int r = 0; r < m.rows; ++r) {
    for (int c = 0; c < m.columns; ++c) {
      m.nodes[m.index(r, c)] =
          plane.dot(basis(Eigen::Vector2d(m.left + c * m.du, m.top + r * m.dv)));
    }
  }

  std::vector<Footprint> footprints(count);
  for (std::size_t i = 0; i < count; ++i) {
    footprints[i] = m.footprint(observations.pixels[i]);
    weight[i] = 1.0;
  }

  struct Difference {
    int node[4];
    double sign[4];
    int terms;
    double pixels_u, pixels_v;
    int centre_row, centre_column;
    double weight = 1.0;
  };
  std::vector<Difference> differences;
  for (int r = 0; r < m.rows; ++r) {
    for (int c = 0; c < m.columns; ++c) {
      if (r + 2 < m.rows) {
        differences.push_back({{m.index(r, c), m.index(r + 1, c), m.index(r + 2, c), 0},
                               {1, -2, 1, 0},
                               3,
                               0,
                               m.dv,
                               r + 1,
                               c});
      }
      if (c + 2 < m.columns) {
        differences.push_back({{m.index(r, c), m.index(r, c + 1), m.index(r, c + 2), 0},
                               {1, -2, 1, 0},
                               3,
                               m.du,
                               0,
                               r,
                               c + 1});
      }
      if (r + 1 < m.rows && c + 1 < m.columns) {
        differences.push_back(
            {{m.index(r, c), m.index(r, c + 1), m.index(r + 1, c), m.index(r + 1, c + 1)},
             {1, -1, -1, 1},
             4,
             m.du,
             m.dv,
             r,
             c});
      }
    }
  }

  // Standard deviation of a second difference at a node: curvature times the metric step squared,
  // turned into inverse depth (a rise dh of the plane changes it by rho dh |m|, m = -n / d).
  const double along = options.along_curvature * options.metres_per_unit;
  const double across = options.across_curvature * options.metres_per_unit;
  const double longest_step = 8.0 / options.metres_per_unit;  // roads do not bend one way forever
  const double least_inverse_depth = options.metres_per_unit / 150.0;
  const auto spread = [&](const Difference& d) {
    const int r = std::clamp(d.centre_row, 1, m.rows - 2);
    const int c = std::clamp(d.centre_column, 1, m.columns - 2);
    const double rho = std::max(m.nodes[m.index(r, c)], least_inverse_depth);
    const double rho_u = (m.nodes[m.index(r, c + 1)] - m.nodes[m.index(r, c - 1)]) / (2 * m.du);
    const double rho_v = (m.nodes[m.index(r + 1, c)] - m.nodes[m.index(r - 1, c)]) / (2 * m.dv);
    const double u = m.left + c * m.du - camera.cx, v = m.top + r * m.dv - camera.cy;
    const double inverse_height =
        Eigen::Vector3d(rho_u * camera.fx, rho_v * camera.fy, rho - rho_u * u - rho_v * v).norm();
    const double step_along =
        std::min(longest_step, d.pixels_v * std::abs(rho_v) / (rho * rho) + 1e-6);
    const double step_across = std::min(longest_step, d.pixels_u / (camera.fx * rho) + 1e-6);
    double rise;
    if (d.pixels_u == 0) {
      rise = along * step_along * step_along;
    } else if (d.pixels_v == 0) {
      rise = across * step_across * step_across;
    } else {
      rise = std::sqrt(along * across) * step_along * step_across;
    }
    return std::max(rise * rho * inverse_height, 1e-9);
  };

  Eigen::SparseMatrix<double> normal(n, n);
  Eigen::VectorXd right(n);
  std::vector<Eigen::Triplet<double>> triplets;
  // Dense accumulation of the data term over each cell's 4 x 4 block keeps the triplets few.
  const int cells = (m.columns - 1) * (m.rows - 1);
  std::vector<Eigen::Matrix4d> blocks(static_cast<std::size_t>(cells));
  bool analysed = false;
  for (int iteration = 0; iteration < options.iterations; ++iteration) {
    std::fill(blocks.begin(), blocks.end(), Eigen::Matrix4d::Zero());
    right.setZero();
    for (std::size_t i = 0; i < count; ++i) {
      const Footprint& f = footprints[i];
      const double w =
          weight[i] / (options.correlation * observations.sigma[i] * observations.sigma[i]);
      const int cell = f.node[0] / m.columns * (m.columns - 1) + f.node[0] % m.columns;
      const Eigen::Map<const Eigen::Vector4d> b(f.weight);
      blocks[static_cast<std::size_t>(cell)].noalias() += (w * b) * b.transpose();
      for (int k = 0; k < 4; ++k) {
        right[f.node[k]] += w * f.weight[k] * observations.inverse_depth[i];
      }
    }
    triplets.clear();
    for (int cell = 0; cell < cells; ++cell) {
      const int r = cell / (m.columns - 1), c = cell % (m.columns - 1);
      const int at[4] = {m.index(r, c), m.index(r, c + 1), m.index(r + 1, c),
                         m.index(r + 1, c + 1)};
      for (int j = 0; j < 4; ++j) {
        for (int k = 0; k <= j; ++k) {
          triplets.emplace_back(std::max(at[j], at[k]), std::min(at[j], at[k]),
                                blocks[static_cast<std::size_t>(cell)](j, k));
        }
      }
    }
    for (Difference& d : differences) {
      const double s = spread(d);
      if (iteration > 0) {
        double value = 0.0;
        for (int k = 0; k < d.terms; ++k) value += d.sign[k] * m.nodes[d.node[k]];
        d.weight = 1.0 / (1.0 + value * value / (9.0 * s * s));
      }
      const double w = d.weight / (s * s);
      for (int j = 0; j < d.terms; ++j) {
        for (int k = 0; k <= j; ++k) {
          triplets.emplace_back(std::max(d.node[j], d.node[k]), std::min(d.node[j], d.node[k]),
                                w * d.sign[j] * d.sign[k]);
        }
      }
    }
    normal.setFromTriplets(triplets.begin(), triplets.end());
    if (!analysed) {
      m.solver.analyzePattern(normal);
      analysed = true;
    }
    m.solver.factorize(normal);
    if (m.solver.info() != Eigen::Success) {
      throw std::invalid_argument("ground observations do not fix the field");
    }
    m.nodes = m.solver.solve(right);
    if (iteration + 1 == options.iterations) break;
    for (std::size_t i = 0; i < count; ++i) {
      const double r =
          (observations.inverse_depth[i] - m.value(footprints[i], m.nodes)) / observations.sigma[i];
      weight[i] = 1.0 / (1.0 + r * r / 6.25);
    }
  }

  m.node_support = Eigen::VectorXd::Zero(n);
  const Eigen::Index shared = observations.shared_jacobian.cols();
  Eigen::MatrixXd shared_right = Eigen::MatrixXd::Zero(n, shared);
  for (std::size_t i = 0; i < count; ++i) {
    const Footprint& f = footprints[i];
    const double w =
        weight[i] / (options.correlation * observations.sigma[i] * observations.sigma[i]);
    for (int k = 0; k < 4; ++k) {
      m.node_support[f.node[k]] += weight[i] * f.weight[k];
      if (shared > 0) {
        shared_right.row(f.node[k]) +=
            w * f.weight[k] *
            observations.shared_jacobian.row(static_cast<Eigen::Index>(i)).cast<double>();
      }
    }
  }
  if (shared > 0) m.shared = m.solver.solve(shared_right);
  m.weights = std::move(weight);
}

GroundField::~GroundField() = default;
GroundField::GroundField(GroundField&&) noexcept = default;
GroundField& GroundField::operator=(GroundField&&) noexcept = default;

double GroundField::inverse_depth(const Eigen::Vector2d& pixel) const {
  return impl_->value(impl_->footprint(pixel), impl_->nodes);
}

double GroundField::support(const Eigen::Vector2d& pixel) const {
  return impl_->value(impl_->footprint(pixel), impl_->node_support);
}

double GroundField::top() const { return impl_->top; }

Eigen::MatrixXd GroundField::covariance(const std::vector<Eigen::Vector2d>& pixels,
                                        const Eigen::MatrixXd& coefficients,
                                        const Eigen::MatrixXd& shared_covariance) const {
  const Impl& m = *impl_;
  if (coefficients.cols() != static_cast<Eigen::Index>(pixels.size())) {
    throw std::invalid_argument("coefficients has " + std::to_string(coefficients.cols()) +
                                " columns, expected one for each of " +
                                std::to_string(pixels.size()) + " pixels");
  }
  Eigen::MatrixXd functional = Eigen::MatrixXd::Zero(m.nodes.size(), coefficients.rows());
  for (std::size_t i = 0; i < pixels.size(); ++i) {
    const Footprint f = m.footprint(pixels[i]);
    for (int k = 0; k < 4; ++k) {
      functional.row(f.node[k]) +=
          f.weight[k] * coefficients.col(static_cast<Eigen::Index>(i)).transpose();
    }
  }
  Eigen::MatrixXd out = functional.transpose() * m.solver.solve(functional);
  if (shared_covariance.size() > 0 && m.shared.size() > 0) {
    const Eigen::MatrixXd j = functional.transpose() * m.shared;
    out += j * shared_covariance * j.transpose();
  }
  return 0.5 * (out + out.transpose());
}

const std::vector<double>& GroundField::weights() const { return impl_->weights; }

}  // namespace camber
