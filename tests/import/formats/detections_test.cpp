#include "camber/import/formats/detections.h"

#include <gmock/gmock.h>

#include <cmath>
#include <set>

#include "camber/core/errors.h"
#include "import/formats/expected_values.h"
#include "scene/write_image.h"

namespace camber {
namespace {

using nlohmann::json;
using test::write_bytes;
using testing::HasSubstr;
namespace fs = std::filesystem;

std::vector<double> left_top_width_height(const Box2& b) {
  return {b.x1, b.y1, b.x2 - b.x1, b.y2 - b.y1};
}
std::vector<double> corners(const Box2& b) { return {b.x1, b.y1, b.x2, b.y2}; }

void expect_box(const json& expected, const std::vector<double>& found) {
  ASSERT_EQ(expected.size(), 4u);
  // The set's own values are rounded to six decimals, and widths are differences.
  for (std::size_t i = 0; i < 4; ++i) EXPECT_NEAR(expected[i].get<double>(), found[i], 1e-6);
}

json classes_of(const DetectionFile& file, bool numbers) {
  json out = json::object();
  for (const DetectedImage& image : file.images) {
    for (const DetectedBox& box : image.boxes) {
      const std::string name =
          numbers ? std::to_string(box.class_number.value_or(-1)) : box.class_name;
      out[name] = out.value(name, 0) + 1;
    }
  }
  return out;
}

const DetectedBox& first_box(const DetectionFile& file) {
  for (const DetectedImage& image : file.images) {
    if (!image.boxes.empty()) return image.boxes.front();
  }
  throw std::runtime_error("no box");
}

class ExpectedDetections : public ::testing::Test {
 protected:
  void SetUp() override { all_ = test::expected_values("detections"); }
  DetectionFile read(const std::string& name, const DetectionOptions& options = {}) {
    return read_detections(test::format_file("detections", name), options);
  }
  json all_;
};

TEST_F(ExpectedDetections, Coco) {
  CAMBER_REQUIRE_DATA("format-files/detections/expected.json");
  for (const char* name :
       {"coco/instances_default.json", "coco/roboflow_train_annotations.coco.json"}) {
    SCOPED_TRACE(name);
    const json& expected = all_[name];
    const DetectionFile found = read(name);
    EXPECT_EQ(found.form, DetectionForm::kCocoDataset);
    EXPECT_EQ(expected["images"], found.images.size());
    EXPECT_EQ(expected["boxes"], found.box_count());
    EXPECT_EQ(expected["categories"], found.classes.size());
    EXPECT_EQ(expected["by_category"], classes_of(found, false));
    std::size_t with_boxes = 0;
    for (const DetectedImage& image : found.images) with_boxes += image.boxes.empty() ? 0 : 1;
    EXPECT_EQ(expected["images_with_boxes"], with_boxes);
    const json& first = expected["first"];
    const auto image =
        std::find_if(found.images.begin(), found.images.end(),
                     [&](const DetectedImage& i) { return i.file_name == first["file_name"]; });
    ASSERT_NE(image, found.images.end());
    EXPECT_EQ(first["width"], *image->width);
    EXPECT_EQ(first["height"], *image->height);
    EXPECT_EQ(first["category"], image->boxes[0].class_name);
    EXPECT_TRUE(std::isnan(image->boxes[0].score));
    expect_box(first["bbox"], left_top_width_height(image->boxes[0].box));
  }
  const char* name = "coco/instances_val2014_fakebbox100_results.json";
  const json& expected = all_[name];
  const DetectionFile found = read(name);
  EXPECT_EQ(found.form, DetectionForm::kCocoResults);
  EXPECT_EQ(expected["detections"], found.box_count());
  EXPECT_EQ(expected["images_named"], found.images.size());
  EXPECT_EQ(expected["categories"], classes_of(found, true).size());
  EXPECT_EQ(expected["first"]["image_id"], *found.images[0].number);
  const DetectedBox& first = found.images[0].boxes[0];
  EXPECT_EQ(expected["first"]["category_id"], *first.class_number);
  EXPECT_EQ(first.class_name, "dog");  // 18 of COCO
  EXPECT_EQ(expected["first"]["score"], first.score);
  expect_box(expected["first"]["bbox"], left_top_width_height(first.box));
  double low = 1, high = 0;
  for (const DetectedImage& image : found.images) {
    for (const DetectedBox& box : image.boxes) {
      low = std::min(low, box.score);
      high = std::max(high, box.score);
    }
  }
  EXPECT_EQ(expected["score_range"], json({low, high}));
}

TEST_F(ExpectedDetections, OneFileAnImage) {
  CAMBER_REQUIRE_DATA("format-files/detections/expected.json");
  int files = 0;
  for (const auto& [name, expected] : all_.items()) {
    SCOPED_TRACE(name);
    DetectionOptions options;
    if (expected.contains("image_width")) {
      const std::pair<int, int> size = {expected["image_width"], expected["image_height"]};
      options.image_size = [size](const std::string&) { return std::make_optional(size); };
    }
    const json first = expected.value("first", json());
    if (name.rfind("yolo/obj_train_data/", 0) == 0 || name.rfind("text_abs", 0) == 0) {
      const DetectionFile found = read(name, options);
      EXPECT_EQ(found.form, name[0] == 'y' ? DetectionForm::kYolo : DetectionForm::kAbsoluteText);
      EXPECT_EQ(expected["boxes"], found.box_count());
      EXPECT_EQ(expected["by_class"], classes_of(found, true));
      const DetectedBox& box = first_box(found);
      EXPECT_EQ(first["class"], *box.class_number);
      if (first.contains("name")) {
        EXPECT_EQ(first["name"], box.class_name);
      }  // by obj.names, one folder up
      if (first.contains("score")) {
        EXPECT_EQ(first["score"], box.score);
      }
      expect_box(first["box_left_top_width_height_px"], left_top_width_height(box.box));
    } else if (name.rfind("voc/", 0) == 0) {
      const DetectionFile found = read(name);
      EXPECT_EQ(expected["file_name"], found.images[0].file_name);
      EXPECT_EQ(expected["width"], *found.images[0].width);
      EXPECT_EQ(expected["height"], *found.images[0].height);
      EXPECT_EQ(expected["objects"], found.box_count());
      EXPECT_EQ(expected["by_class"], classes_of(found, false));
      EXPECT_EQ(first["name"], first_box(found).class_name);
      expect_box(first["box"], corners(first_box(found).box));
    } else if (name.rfind("kitti/label", 0) == 0) {
      const DetectionFile found = read(name);
      EXPECT_EQ(expected["rows"], found.box_count());
      EXPECT_EQ(expected["by_type"], classes_of(found, false));
      const json& object = expected["first_object"];
      EXPECT_EQ(object["type"], first_box(found).class_name);
      expect_box(object["box_left_top_right_bottom_px"], corners(first_box(found).box));
    } else {
      continue;
    }
    ++files;
  }
  EXPECT_EQ(files, 17);
}

TEST_F(ExpectedDetections, MotBddCvat) {
  CAMBER_REQUIRE_DATA("format-files/detections/expected.json");
  for (const char* name :
       {"mot/KITTI-17_det.txt", "mot/TUD-Campus/result.txt", "mot/TUD-Campus/gt/gt.txt"}) {
    SCOPED_TRACE(name);
    const json& expected = all_[name];
    const DetectionFile found = read(name);
    EXPECT_EQ(found.form, DetectionForm::kMot);
    EXPECT_EQ(expected["rows"], found.box_count());
    EXPECT_EQ(expected["frames"], found.images.size());
    std::set<std::int64_t> ids;
    double low = 2, high = -2;
    for (const DetectedImage& image : found.images) {
      for (const DetectedBox& box : image.boxes) {
        ids.insert(box.track);
        low = std::min(low, box.score);
        high = std::max(high, box.score);
      }
    }
    EXPECT_EQ(expected["ids"], ids.size());
    EXPECT_EQ(expected["confidence_range"], json({low, high}));
    const DetectedImage &first = found.images.front(), &last = found.images.back();
    EXPECT_EQ(expected["first"]["frame"], *first.number);
    EXPECT_EQ(expected["first"]["id"], first.boxes.front().track);
    expect_box(expected["first"]["box_left_top_width_height_px"],
               left_top_width_height(first.boxes.front().box));
    EXPECT_EQ(expected["last"]["frame"], *last.number);
    EXPECT_EQ(expected["last"]["id"], last.boxes.back().track);
    EXPECT_EQ(expected["last"]["confidence"], last.boxes.back().score);
  }
  const DetectionFile bdd = read("bdd100k/example_annotation.json");
  EXPECT_EQ(bdd.form, DetectionForm::kBdd);
  EXPECT_EQ(bdd.images.size(), 1u);
  EXPECT_EQ(bdd.box_count(), 0u);
  EXPECT_EQ(bdd.other_shapes.at("poly2d"),
            all_["bdd100k/example_annotation.json"]["labels_with_poly2d"]);
  const DetectionFile cvat = read("cvat/train.xml");
  const json& expected = all_["cvat/train.xml"];
  EXPECT_EQ(expected["images"], cvat.images.size());
  EXPECT_EQ(expected["by_label"], classes_of(cvat, false));
  json shapes = cvat.other_shapes;
  shapes["box"] = cvat.box_count();
  shapes.erase("tag");  // of the whole image, no shape
  EXPECT_EQ(expected["shapes"], shapes);
  EXPECT_EQ(expected["first"]["image"], cvat.images[0].file_name);
  EXPECT_EQ(expected["first"]["width"], *cvat.images[0].width);
  expect_box(expected["first"]["box_left_top_right_bottom_px"], corners(first_box(cvat).box));
}

TEST_F(ExpectedDetections, NamesAndFacts) {
  CAMBER_REQUIRE_DATA("format-files/detections/expected.json");
  const auto names = read_class_names(test::format_file("detections", "yolo/obj.names"));
  json list = json::array();
  for (const auto& [number, name] : names) list.push_back(name);
  EXPECT_EQ(all_["yolo/obj.names"]["names"], list);
  EXPECT_EQ(names, read_class_names(test::format_file("detections", "yolo/obj.data")));
  EXPECT_EQ(all_["yolo/obj.data"],
            json(read_key_values(test::format_file("detections", "yolo/obj.data"))));
  EXPECT_EQ(all_["mot/TUD-Campus/seqinfo.ini"],
            json(read_key_values(test::format_file("detections", "mot/TUD-Campus/seqinfo.ini"))));
}

TEST_F(ExpectedDetections, TrackletsAreRefused) {
  CAMBER_REQUIRE_DATA("format-files/detections/expected.json");
  try {
    read("kitti/tracklet_labels.xml");
    FAIL();
  } catch (const InputError& error) {
    EXPECT_THAT(error.what(),
                HasSubstr("3D boxes in the laser scanner's frame, expected boxes in images"));
  }
}

class Detections : public ::testing::Test {
 protected:
  fs::path file(const std::string& name, const std::string& text) {
    fs::create_directories((folder_.path() / name).parent_path());
    write_bytes(folder_.path() / name, text);
    return folder_.path() / name;
  }
  DetectionFile read(const std::string& name, const std::string& text) {
    DetectionOptions options;
    options.image_size = [](const std::string&) {
      return std::make_optional(std::make_pair(200, 100));
    };
    return read_detections(file(name, text), options);
  }
  std::string error_of(const std::string& name, const std::string& text) {
    try {
      read(name, text);
    } catch (const InputError& error) {
      return error.what();
    }
    return "no error";
  }
  test::TemporaryFolder folder_;
};

TEST_F(Detections, YoloRowsWithScoresTracksAndPolygons) {
  const DetectionFile found =
      read("a.txt",
           "2 0.5 0.5 0.2 0.4\n7 0.5 0.5 0.2 0.4 0.9\n2 .5 .5 .2 .4 12\n"
           "2 0.5 0.5 0.2 0.4 0.75 3\n2 0.1 0.2 0.3 0.2 0.2 0.6 0.15 0.5\n");
  ASSERT_EQ(found.box_count(), 5u);
  const std::vector<DetectedBox>& boxes = found.images[0].boxes;
  EXPECT_EQ(boxes[0].class_name, "car");  // COCO's names where there are no others
  EXPECT_EQ(boxes[1].class_name, "truck");
  EXPECT_EQ(boxes[1].score, 0.9);
  EXPECT_EQ(boxes[2].track, 12);
  EXPECT_EQ(boxes[3].score, 0.75);
  EXPECT_EQ(boxes[3].track, 3);
  EXPECT_DOUBLE_EQ(boxes[4].box.x1, 20.0);
  EXPECT_DOUBLE_EQ(boxes[4].box.x2, 60.0);
  EXPECT_DOUBLE_EQ(boxes[4].box.y2, 60.0);
  EXPECT_EQ(found.images[0].file_name, "a");
}

TEST_F(Detections, AFolderHasAFileAnImage) {
  file("set/f10.txt", "0 0.5 0.5 0.2 0.4\n");
  file("set/f2.txt", "");
  file("set/classes.txt", "lorry\n");
  DetectionOptions options;
  options.image_size = [](const std::string&) {
    return std::make_optional(std::make_pair(200, 100));
  };
  const DetectionFile found = read_detections(folder_.path() / "set", options);
  ASSERT_EQ(found.images.size(), 2u);
  EXPECT_EQ(found.images[0].file_name, "f2");
  EXPECT_EQ(found.images[1].boxes[0].class_name, "lorry");
  file("set/f3.txt", "0 0.9 10 20 30 40\n");
  EXPECT_THROW(read_detections(folder_.path() / "set", options), InputError);
  fs::create_directories(folder_.path() / "none");
  EXPECT_THROW(read_detections(folder_.path() / "none"), InputError);
}

TEST_F(Detections, CvatVideoBddTracksAndMotTruth) {
  const DetectionFile cvat =
      read("v.xml",
           "<annotations><track id=\"4\" label=\"car\">"
           "<box frame=\"7\" xtl=\"1\" ytl=\"2\" xbr=\"3\" ybr=\"4\" outside=\"0\"/>"
           "<box frame=\"8\" xtl=\"1\" ytl=\"2\" xbr=\"3\" ybr=\"4\" outside=\"1\"/>"
           "</track></annotations>");
  ASSERT_EQ(cvat.box_count(), 1u);
  EXPECT_EQ(cvat.images[0].number, 7);
  EXPECT_EQ(cvat.images[0].boxes[0].track, 4);
  const DetectionFile bdd =
      read("b.json", R"({"frames": [{"name": "a.jpg", "videoName": "a", "frameIndex": 3, "labels": [
      {"id": "x9", "category": "truck", "score": 0.5, "box2d": {"x1": 1, "y1": 2, "x2": 3, "y2": 4}}]}]})");
  EXPECT_EQ(bdd.images[0].number, 3);
  EXPECT_EQ(bdd.images[0].boxes[0].class_name, "truck");
  EXPECT_EQ(bdd.images[0].boxes[0].track, 0);
  const DetectionFile truth = read("gt.txt", "1,1,10,20,30,40,1,3,0.9\n1,2,10,20,30,40,0,1,0.1\n");
  EXPECT_EQ(truth.images[0].boxes[0].class_name, "car");
  EXPECT_FALSE(truth.images[0].boxes[0].ignored);
  EXPECT_TRUE(truth.images[0].boxes[1].ignored);
}

TEST_F(Detections, OtherListsAreNotTakenForCocoOrBdd) {
  // Label Studio, a detector of its own making, Cityscapes, a list of frames of something else.
  for (const char* const text :
       {R"([{"id": 1, "data": {"image": "f0.jpg"}, "annotations": [{"result": [{"value":
          {"x": 10, "y": 20, "width": 5, "height": 6, "rectanglelabels": ["Car"]}}]}]}])",
        R"([{"image_id": 1, "category_id": 3, "box": [1, 2, 30, 40]}])",
        R"([{"file": "f0.jpg", "detections": [{"label": "car", "box": [1, 2, 3, 4]}]}])",
        R"({"imgHeight": 100, "imgWidth": 200, "objects": [{"label": "car", "polygon":
          [[1, 2], [3, 4], [5, 6]]}]})",
        R"([{"name": "f0.jpg", "boxes": [{"class": "car", "x": 1, "y": 2, "w": 3, "h": 4}]}])",
        R"([{"name": "f0.jpg", "labels": [{"class": "car", "x": 1, "y": 2, "w": 3, "h": 4}]}])",
        R"({"images": [{"id": 1, "file_name": "f0.jpg"}], "annotations": [{"id": 1, "label": "car",
          "image_id": 1, "box": [1, 2, 3, 4]}]})",
        R"({"images": [{"id": 1, "file_name": "f0.jpg"}], "annotations": [{"id": 1, "image_id": 1,
          "caption": "a road"}]})"}) {
    EXPECT_THAT(error_of("a.json", text), HasSubstr("expected")) << text;
  }
  // A detector that found nothing.
  EXPECT_EQ(read("a.json", "[]").box_count(), 0u);
  EXPECT_EQ(read("a.json", R"([{"name": "a.jpg", "labels": null}])").images.size(), 1u);
}

TEST_F(Detections, IdsThatAreTextNameFiles) {
  const DetectionFile found =
      read("a.json",
           R"([{"image_id": "f00", "category_id": 3, "bbox": [1, 2, 30, 40], "score": 0.9},
          {"image_id": "f01", "file_name": "front/f01.jpg", "category_id": 3, "bbox": [1, 2, 3, 4]},
          {"image_id": "f00", "category_id": 8, "bbox": [5, 6, 7, 8]},
          {"image_id": "000042", "category_id": 3, "bbox": [1, 2, 3, 4]}])");
  ASSERT_EQ(found.images.size(), 3u);
  EXPECT_EQ(found.images[0].file_name, "f00");
  EXPECT_EQ(found.images[0].boxes.size(), 2u);
  EXPECT_FALSE(found.images[0].number);
  EXPECT_EQ(found.images[1].file_name, "front/f01.jpg");
  EXPECT_EQ(found.images[2].number, 42);
  const DetectionFile set =
      read("b.json",
           R"({"images": [{"id": "a", "file_name": "x.png"}, {"id": "b", "file_name": "y.png"}],
          "categories": [{"id": 1, "name": "car"}],
          "annotations": [{"image_id": "b", "category_id": 1, "bbox": [1, 2, 3, 4]}]})");
  EXPECT_TRUE(set.images[0].boxes.empty());
  EXPECT_EQ(set.images[1].boxes.size(), 1u);
}

TEST_F(Detections, OfVisDroneAreNotMot) {
  const DetectionFile image =
      read("f07.txt", "100,20,80,60,1,4,0,0\n10,20,30,40,0,0,0,0\n1,2,30,40,1,9,1,2\n");
  EXPECT_EQ(image.form, DetectionForm::kVisDrone);
  ASSERT_EQ(image.images.size(), 1u);
  EXPECT_EQ(image.images[0].file_name, "f07");
  const std::vector<DetectedBox>& boxes = image.images[0].boxes;
  ASSERT_EQ(boxes.size(), 3u);
  EXPECT_EQ(corners(boxes[0].box), (std::vector<double>{100, 20, 180, 80}));
  EXPECT_EQ(boxes[0].class_name, "car");
  EXPECT_FALSE(boxes[0].ignored);
  EXPECT_TRUE(boxes[1].ignored);
  EXPECT_EQ(boxes[2].class_name, "bus");
  const DetectionFile found = read("f08.txt", "100,20,80,60,0.75,6,-1,-1\n");
  EXPECT_EQ(found.images[0].boxes[0].class_name, "truck");
  EXPECT_EQ(found.images[0].boxes[0].score, 0.75);
  const DetectionFile video =
      read("v.txt", "1,0,593,43,174,190,0,0,0,0\n2,7,100,20,80,60,1,5,0,1\n");
  EXPECT_EQ(video.form, DetectionForm::kVisDroneVideo);
  ASSERT_EQ(video.images.size(), 2u);
  EXPECT_TRUE(video.images[0].boxes[0].ignored);
  EXPECT_EQ(video.images[1].number, 2);
  EXPECT_EQ(video.images[1].boxes[0].class_name, "van");
  EXPECT_EQ(video.images[1].boxes[0].track, 7);
  // MOT's own detections.
  EXPECT_EQ(read("m.txt", "1,-1,593,43,174,190,0.9,-1,-1,-1\n").form, DetectionForm::kMot);
}

TEST_F(Detections, ColumnsInAnotherOrderAreRefused) {
  // left top right bottom score class; class left top right bottom score
  for (const char* const rows :
       {"10,20,80,60,0.9,2\n50,20,90,60,0.8,2\n", "2,10,20,80,60,0.9\n2,50,20,90,60,0.8\n",
        "car 10 20 80 60 0.9\ncar 50 20 90 60 0.8\n",
        // class score left top right bottom: within 200 x 100 as corners alone
        "car 0.9 120 20 180 60\ncar 0.8 130 40 190 90\n"}) {
    EXPECT_THAT(error_of("a.txt", rows), HasSubstr("expected")) << rows;
  }
  EXPECT_EQ(read("a.txt", "car 0.9 120 20 70 60\ncar 0.8 13 4 19 9\n").box_count(), 2u);
}

TEST_F(Detections, ThatAreBrokenAreRefusedWithTheirPosition) {
  EXPECT_THAT(
      error_of("a.json", "[{\"image_id\": 1, \"category_id\": 3, \"bbox\": [1, 2, -3, 4]}]"),
      HasSubstr("[0].bbox: found a box of -3 x 4 pixels"));
  EXPECT_THAT(error_of("a.json", "[{\"image_id\": 1, \"category_id\": 3, \"bbox\": [1, 2, 3]}]"),
              HasSubstr("[0].bbox: found 3 numbers, expected 4"));
  EXPECT_THAT(error_of("a.json", "{\"images\": [], \"categories\": []}"),
              HasSubstr("annotations: missing"));
  EXPECT_THAT(error_of("a.json",
                       "{\"images\": [], \"annotations\": [{\"image_id\": 4, \"category_id\": 1, "
                       "\"bbox\": [1,2,3,4]}]}"),
              HasSubstr("annotations[0].image_id: found 4, expected the id of one of the images"));
  EXPECT_THAT(error_of("a.json", "{\"a\": 1}"), HasSubstr("expected a COCO data set"));
  EXPECT_THAT(error_of("a.json", "[{\"image_id\": 1, "), HasSubstr("a.json: line 1"));
  EXPECT_THAT(error_of("a.xml",
                       "<annotation><object>\n<name>car</name><bndbox><xmin>5</xmin><ymin>1</"
                       "ymin><xmax>2</xmax><ymax>3</ymax></bndbox></object></annotation>"),
              HasSubstr("line 2: found a box from 5, 1 to 2, 3"));
  EXPECT_THAT(error_of("a.xml", "<annotation><object>"), HasSubstr("damaged XML"));
  EXPECT_THAT(error_of("a.xml", "<svg/>"), HasSubstr("found <svg>"));
  EXPECT_THAT(error_of("a.txt", "0 0.5 x 0.2 0.4\n"), HasSubstr("line 1, column 7: found 'x'"));
  EXPECT_THAT(error_of("a.txt", "0 0.5 0.5\n"), HasSubstr("line 1: found 3 columns"));
  EXPECT_THAT(error_of("a.txt", "1,2,3\n"), HasSubstr("line 1: found 3 columns, expected frame"));
  EXPECT_THAT(error_of("a.txt", "1,1,10,20,-30,40,1\n"), HasSubstr("no negative size"));
  EXPECT_THAT(error_of("a.txt", "1,1,10,20,nan,40,1\n"), HasSubstr("field 5: found 'nan'"));
  EXPECT_THAT(error_of("a.txt", "1,18446744073709551616,10,20,30,40,1\n"),
              HasSubstr("field 2: found '18446744073709551616', expected a whole number"));
  for (const char* const element : {"image", "track"}) {
    EXPECT_THAT(error_of("a.xml", "<annotations><" + std::string(element) +
                                      " id=\"1e300\" name=\"f.png\"/></annotations>"),
                HasSubstr("line 1: found id 1e+300, expected a whole number"));
  }
}

}  // namespace
}  // namespace camber
