# Debian 12's packages. VTK's configuration asks for MPI's C bindings first.
find_package(Threads REQUIRED)
find_package(Eigen3 3.4 REQUIRED NO_MODULE)
find_package(fmt REQUIRED)
find_package(nlohmann_json REQUIRED)
find_package(TBB REQUIRED)
find_package(PNG REQUIRED)
find_path(PROJ_INCLUDE_DIR proj.h REQUIRED)
find_library(PROJ_LIBRARY proj REQUIRED)
find_package(JPEG REQUIRED)
find_path(TOMLPLUSPLUS_INCLUDE_DIR toml++/toml.h REQUIRED)
find_package(yaml-cpp REQUIRED)
find_package(pugixml REQUIRED)
find_package(OpenCV REQUIRED COMPONENTS core imgproc calib3d dnn features2d video videoio)
find_package(Ceres REQUIRED)
find_package(embree 3.13 REQUIRED)
find_package(MPI REQUIRED COMPONENTS C)
find_package(VTK 9.1 REQUIRED
             COMPONENTS CommonColor CommonCore CommonDataModel CommonExecutionModel CommonMath
                        FiltersCore FiltersSources InteractionStyle RenderingCore RenderingFreeType
                        RenderingOpenGL2
             OPTIONAL_COMPONENTS GUISupportQt)
# By path: PCL's own configuration finds all that any part of PCL needs, VTK and Qt among it.
find_path(PCL_INCLUDE_DIRS pcl/sample_consensus/msac.h
          PATH_SUFFIXES pcl-1.13 pcl-1.14 pcl-1.15 REQUIRED)
find_library(PCL_COMMON_LIBRARY pcl_common REQUIRED)
find_library(PCL_SAMPLE_CONSENSUS_LIBRARY pcl_sample_consensus REQUIRED)
# FFmpeg's libraries: videos.
find_path(LIBAV_INCLUDE_DIR libavformat/avformat.h REQUIRED)
set(LIBAV_LIBRARIES "")
foreach(name avformat avcodec swscale avutil)
  find_library(LIBAV_${name}_LIBRARY ${name} REQUIRED)
  list(APPEND LIBAV_LIBRARIES ${LIBAV_${name}_LIBRARY})
endforeach()
find_path(LZF_INCLUDE_DIR liblzf/lzf.h REQUIRED)
find_library(LZF_LIBRARY lzf REQUIRED)
find_path(XXHASH_INCLUDE_DIR xxhash.h REQUIRED)
find_library(XXHASH_LIBRARY xxhash REQUIRED)
