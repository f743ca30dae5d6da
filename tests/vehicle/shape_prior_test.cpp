#include "camber/vehicle/shape_prior.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <Eigen/Eigenvalues>
#include <fstream>

#include "camber/core/errors.h"
#include "camber/synth/car_family.h"
#include "camber/synth/family_prior.h"
#include "support/test_data.h"

namespace camber {
namespace {

void expect_close(const Eigen::MatrixXd& a, const Eigen::MatrixXd& b, double tolerance) {
  ASSERT_EQ(a.rows(), b.rows());
  ASSERT_EQ(a.cols(), b.cols());
  EXPECT_LT((a - b).cwiseAbs().maxCoeff(), tolerance);
}

TEST(ShippedPrior, IsWhatItsGeneratorMakes) {
  const VehiclePrior made = learn_family_prior({});
  const VehiclePrior& shipped = shipped_vehicle_prior();
  EXPECT_EQ(made.source, shipped.source);
  ASSERT_EQ(made.shapes.size(), shipped.shapes.size());
  for (std::size_t i = 0; i < made.shapes.size(); ++i) {
    const ShapePrior &a = made.shapes[i], &b = shipped.shapes[i];
    EXPECT_EQ(a.name, b.name);
    EXPECT_EQ(a.samples, b.samples);
    // The file has nine digits; components close in variance turn by rounding on other machines.
    expect_close(a.mean, b.mean, 1e-8);
    expect_close(a.parameters_mean, b.parameters_mean, 1e-7);
    ASSERT_EQ(a.num_coefficients(), b.num_coefficients());
    for (int k = 0; k < a.num_coefficients(); ++k) expect_close(a.basis[k], b.basis[k], 1e-6);
    expect_close(a.parameters_covariance, b.parameters_covariance, 1e-5);
    expect_close(a.sigma, b.sigma, 1e-8);
  }
  ASSERT_EQ(made.sizes.size(), shipped.sizes.size());
  for (std::size_t i = 0; i < made.sizes.size(); ++i) {
    EXPECT_EQ(made.sizes[i].name, shipped.sizes[i].name);
    expect_close(made.sizes[i].covariance, shipped.sizes[i].covariance, 1e-8);
  }
}

TEST(ShapePrior, CoefficientsAreWhiteAndExplainTheirSamples) {
  std::vector<ShapeSample> samples;
  for (int i = 0; i < 500; ++i) {
    const CarModel car = sample_car(CarClass::kHatchback, CounterRandom(2), i);
    ShapeSample s;
    s.dimensions = car.dimensions;
    for (int k = 0; k < kNumKeypoints; ++k) s.keypoints.col(k) = car.keypoints[k];
    samples.push_back(s);
  }
  const ShapePrior prior = learn_shape_prior("hatchback", samples, {10});
  ASSERT_EQ(prior.num_coefficients(), 10);
  expect_close(prior.parameters_covariance.bottomRightCorner(10, 10),
               Eigen::MatrixXd::Identity(10, 10), 1e-9);
  for (int k = 0; k < 10; ++k) {
    EXPECT_GT(prior.residual_sigma(k).squaredNorm(), prior.residual_sigma(k + 1).squaredNorm());
  }
  // Least squares on the ten directions leaves what residual_sigma says.
  double sum = 0.0;
  for (const ShapeSample& s : samples) {
    const Eigen::Vector3d size(s.dimensions.length, s.dimensions.height, s.dimensions.width);
    Eigen::MatrixXd basis(54, 10);
    for (int k = 0; k < 10; ++k) {
      const Eigen::Matrix<double, 3, 18> metres =
          Eigen::Vector3d(prior.parameters_mean[0], prior.parameters_mean[2],
                          prior.parameters_mean[1])
              .asDiagonal() *
          prior.basis[k];
      basis.col(k) = Eigen::Map<const Eigen::VectorXd>(metres.data(), 54);
    }
    const Eigen::Matrix<double, 3, 18> difference =
        Eigen::Vector3d(prior.parameters_mean[0], prior.parameters_mean[2],
                        prior.parameters_mean[1])
            .asDiagonal() *
        (size.cwiseInverse().asDiagonal() * s.keypoints.leftCols<18>() - prior.mean);
    const Eigen::VectorXd d = Eigen::Map<const Eigen::VectorXd>(difference.data(), 54);
    const Eigen::VectorXd a = basis.colPivHouseholderQr().solve(d);
    sum += (d - basis * a).squaredNorm();
  }
  EXPECT_NEAR(sum / 499.0, prior.residual_sigma(10).squaredNorm(), 1e-9);
}

TEST(ShapePrior, KeypointsAreMirroredAndScaled) {
  const ShapePrior& prior = shipped_vehicle_prior().shape("car");
  const KeypointMatrix k = prior.keypoints({4.2, 1.8, 1.5}, {1.0, -0.5});
  for (int i = 0; i < kNumSideKeypoints; ++i) {
    EXPECT_EQ(k(0, i), k(0, i + 18));
    EXPECT_EQ(k(1, i), k(1, i + 18));
    EXPECT_EQ(k(2, i), -k(2, i + 18));
    EXPECT_LT(k(2, i), 0.0);
  }
  const KeypointMatrix twice = prior.keypoints({8.4, 3.6, 3.0}, {1.0, -0.5});
  EXPECT_LT((twice - 2.0 * k).cwiseAbs().maxCoeff(), 1e-12);
  EXPECT_THROW(prior.keypoints({4, 2, 1}, std::vector<double>(99)), std::invalid_argument);
}

TEST(VehiclePrior, ClassesAreFoundWhateverTheirCase) {
  const VehiclePrior& prior = shipped_vehicle_prior();
  EXPECT_EQ(prior.shape("Car").name, "car");
  EXPECT_EQ(prior.shape("VAN").name, "van");
  EXPECT_EQ(prior.shape("hovercraft").name, "car");
  EXPECT_FALSE(prior.has_shape("Truck"));
  EXPECT_TRUE(prior.has_shape("van"));
  EXPECT_GT(prior.size("truck").mean[0], prior.size("van").mean[0]);
  for (const SizePrior& s : prior.sizes) {
    EXPECT_GT(Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d>(s.covariance).eigenvalues()[0], 0.0);
  }
}

TEST(PriorFile, RoundTripGivesTheSameBytes) {
  const std::string text = vehicle_prior_text(shipped_vehicle_prior());
  EXPECT_EQ(vehicle_prior_text(parse_vehicle_prior(text, "x")), text);
  test::TemporaryFolder folder;
  write_vehicle_prior(shipped_vehicle_prior(), folder.path() / "prior.json");
  EXPECT_EQ(vehicle_prior_text(read_vehicle_prior(folder.path() / "prior.json")), text);
}

std::string message_of(const std::string& text) {
  try {
    parse_vehicle_prior(text, "p.json");
  } catch (const InputError& error) {
    return error.what();
  }
  return "no error";
}

TEST(PriorFile, NumbersBeyondTheirRangeAreNamed) {
  const std::string text = vehicle_prior_text(shipped_vehicle_prior());
  const auto with = [&](const std::string& key, const std::string& value) {
    std::string changed = text;
    const std::size_t at = changed.find('"' + key + "\": [");
    const std::size_t begin = changed.find_first_of("-0123456789", at + key.size());
    changed.replace(begin, changed.find_first_of(",]", begin) - begin, value);
    return message_of(changed);
  };
  for (const char* key : {"mean", "basis", "sigma", "dimensions", "covariance"}) {
    EXPECT_THAT(with(key, "1e309"), ::testing::HasSubstr("beyond the range of double")) << key;
    for (const char* number : {"1e308", "-1e308", "1e155", "1e7"}) {
      EXPECT_THAT(with(key, number), ::testing::HasSubstr("expected a number of at most 1e+06"))
          << key << " " << number;
    }
  }
}

TEST(PriorFile, DamageIsNamed) {
  EXPECT_EQ(message_of("{"), "p.json: byte 2: found no JSON, expected a prior");
  EXPECT_EQ(message_of("[]"), "p.json: top level: found an array of 0, expected an object");
  EXPECT_EQ(message_of(R"({"format": "x"})"),
            "p.json: format: found string, expected \"camber-prior\"");
  std::string text = vehicle_prior_text(shipped_vehicle_prior());
  text.replace(text.find("\"mean\": [") + 9, 0, "1, ");
  EXPECT_EQ(message_of(text), "p.json: shapes[0].mean: found an array of 55, expected 54 numbers");
  EXPECT_THROW(read_vehicle_prior("/nowhere/prior.json"), InputError);
}

TEST(ShapePrior, BadSamplesAreRejected) {
  EXPECT_THROW(learn_shape_prior("x", {}, {}), std::invalid_argument);
  std::vector<ShapeSample> flat(3);
  for (ShapeSample& s : flat) s.keypoints.setOnes();
  EXPECT_THROW(learn_shape_prior("x", flat, {}), std::invalid_argument);
  EXPECT_THROW(learn_shape_prior("x", flat, {-1}), std::invalid_argument);
}

}  // namespace
}  // namespace camber
