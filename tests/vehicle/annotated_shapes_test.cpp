#include "camber/vehicle/annotated_shapes.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <fstream>

#include "camber/core/errors.h"
#include "camber/synth/car_family.h"
#include "support/test_data.h"

namespace camber {
namespace {

AnnotatedShape family_shape(int index) {
  AnnotatedShape out;
  out.name = "car" + std::to_string(index);
  const CarModel car = sample_car(CarClass::kSaloon, CounterRandom(8), index);
  for (int i = 0; i < kNumKeypoints; ++i) out.keypoints.col(i) = car.keypoints[i];
  return out;
}

TEST(ExplainShape, UndoesScaleAndShift) {
  const ShapePrior& prior = shipped_vehicle_prior().shape("car");
  AnnotatedShape shape;
  const std::vector<double> coefficients{0.8, -0.4, 0.3};
  shape.keypoints = prior.keypoints(prior.mean_dimensions(), coefficients);
  shape.keypoints = Eigen::Vector3d(0.2, 0.3, 0.25).asDiagonal() * shape.keypoints;
  shape.keypoints.colwise() += Eigen::Vector3d(0.4, -0.2, 0.0);
  const ShapeExplanation e = explain_shape(prior, shape, 3);
  // Held weakly to the prior: a few millimetres stay.
  EXPECT_LT(e.mean_residual, 0.004);
  for (int k = 0; k < 3; ++k) EXPECT_NEAR(e.coefficients[k], coefficients[k], 0.1);
  EXPECT_GT(explain_shape(prior, shape, 0).mean_residual, 0.01);
  EXPECT_THROW(explain_shape(prior, shape, 99), std::invalid_argument);
}

TEST(LearnAnnotatedPrior, FindsTheGrossError) {
  std::vector<AnnotatedShape> shapes;
  for (int i = 0; i < 60; ++i) shapes.push_back(family_shape(i));
  shapes[17].keypoints.row(0) *= -1.0;  // front and rear swapped
  shapes[40].keypoints.col(13) += Eigen::Vector3d(3.0, 4.0, 0.0);
  const AnnotatedPrior learnt =
      learn_annotated_prior("saloon", shapes, shipped_vehicle_prior().shape("car"), nullptr, {10});
  EXPECT_EQ(learnt.outliers, (std::vector<int>{17, 40}));
  EXPECT_EQ(learnt.prior.samples, 58);
  EXPECT_EQ(learnt.prior.num_coefficients(), 10);
  EXPECT_NEAR(learnt.prior.parameters_mean[0],
              shipped_vehicle_prior().shape("car").parameters_mean[0], 1e-12);
}

TEST(ReadAnnotatedShapes, NamesTheLine) {
  test::TemporaryFolder folder;
  const auto path = folder.path() / "shapes.csv";
  std::ofstream(path) << "model,x00\ncar,1,2\n";
  try {
    read_annotated_shapes(path);
    FAIL();
  } catch (const InputError& error) {
    EXPECT_NE(std::string(error.what()).find("line 2: found 3 fields"), std::string::npos)
        << error.what();
  }
  EXPECT_THROW(read_annotated_shapes(folder.path() / "none.csv"), InputError);
}

// The family is made from published dimensions; the annotated cars only measure it.
TEST(ShippedPrior, ExplainsRealAnnotatedCarsNearlyAsWellAsTheirOwn) {
  CAMBER_REQUIRE_DATA("car-keypoints-36/annotated_shapes.csv");
  const auto shapes =
      read_annotated_shapes(test::data_dir() / "car-keypoints-36" / "annotated_shapes.csv");
  ASSERT_EQ(shapes.size(), 473u);
  std::vector<AnnotatedShape> half, others;
  for (std::size_t i = 0; i < shapes.size(); ++i) (i % 2 ? half : others).push_back(shapes[i]);
  const ShapePrior& shipped = shipped_vehicle_prior().shape("car");
  const ShapePrior own = learn_annotated_prior("half", half, shipped, nullptr, {20}).prior;
  double by_shipped = 0.0, by_own = 0.0;
  for (const AnnotatedShape& s : others) {
    by_shipped += explain_shape(shipped, s, 10).mean_residual / others.size();
    by_own += explain_shape(own, s, 10).mean_residual / others.size();
  }
  EXPECT_LT(by_shipped, 2.0 * by_own);
  EXPECT_LT(by_shipped, 0.09);  // m; 0.074 measured
}

}  // namespace
}  // namespace camber
