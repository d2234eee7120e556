# The library as others link it: components, each one library made of the objects of its modules, and
# how they are installed.
include(GNUInstallDirs)
include(CMakePackageConfigHelpers)

set(palpate_all_components formats devices session viewer scenes cameras c)
set(palpate_components ${PALPATE_COMPONENTS})
if(PALPATE_APPS)
  set(palpate_components ${palpate_all_components})
endif()
if("viewer" IN_LIST palpate_components)
  list(APPEND palpate_components session)
endif()
if("cameras" IN_LIST palpate_components)
  list(APPEND palpate_components formats devices session scenes)
endif()
if("c" IN_LIST palpate_components)
  list(APPEND palpate_components scenes)
endif()
list(REMOVE_DUPLICATES palpate_components)
foreach(component IN LISTS palpate_components)
  if(NOT component IN_LIST palpate_all_components)
    message(FATAL_ERROR "PALPATE_COMPONENTS: there is no component ${component}; there are: ${palpate_all_components}")
  endif()
endforeach()

# Separate packages of the program, the shared libraries and what a compiler needs.
set(palpate_install_runtime COMPONENT library)
set(palpate_install_dev COMPONENT development)

# palpate_write_map(FILE): what a shared library of ours shows (decision 37): names of public headers, with the
# version PALPATE_0; and with PALPATE_PRIVATE all others of the namespace, which the components need of each other.
# A program that needs one of those relies on what may change at any time. Nothing else is shown: nothing of what was
# compiled in from other libraries, or as a template of theirs. Names in headers begin their lines.
function(palpate_write_map file)
  file(GLOB_RECURSE headers CONFIGURE_DEPENDS "${PROJECT_SOURCE_DIR}/include/*.h")
  set(patterns "")
  foreach(header IN LISTS headers "${PROJECT_SOURCE_DIR}/scenes/scene.h")
    file(STRINGS "${header}" lines REGEX "^(class|struct) [A-Za-z]|^[A-Za-z[][^=]*[a-z_0-9]+\\(|^[a-z_0-9]+\\(")
    foreach(line IN LISTS lines)
      if(line MATCHES "^(class|struct) ([A-Za-z]+)")
        set(name "palpate::v0::${CMAKE_MATCH_2}")
        list(APPEND patterns "${name}::*" "typeinfo?for?${name}" "typeinfo?name?for?${name}" "vtable?for?${name}")
      elseif(NOT line MATCHES "^(static_assert|template|inline|constexpr)" AND line MATCHES "^([^(]*[ *&>])?([a-z_0-9]+)[(]")
        list(APPEND patterns "palpate::v0::${CMAKE_MATCH_2}[!a-z0-9_]*")  # its parameters follow, or [abi:cxx11]
      endif()
    endforeach()
  endforeach()
  list(REMOVE_DUPLICATES patterns)
  list(JOIN patterns ";\n    " patterns)
  file(CONFIGURE OUTPUT "${file}" @ONLY CONTENT "PALPATE_PRIVATE {
  global: extern \"C++\" {
    palpate::*;
    typeinfo?for?palpate::*;
    typeinfo?name?for?palpate::*;
    vtable?for?palpate::*;
    guard?variable?for?palpate::*;
  };
  local: *;
};
PALPATE_0 {
  global: extern \"C++\" {
    ${patterns};
  };
};
")
endfunction()
set(palpate_map "${PROJECT_BINARY_DIR}/palpate.map")
if(BUILD_SHARED_LIBS)
  palpate_write_map("${palpate_map}")
endif()

# palpate_component(NAME [DEPENDS components ...] [HEADERS folders and files below include/palpate ...])
# The library palpate::NAME (core: palpate::palpate) out of the modules of that component so far, static
# or shared as BUILD_SHARED_LIBS says. Headers that no component names belong to core.
function(palpate_component name)
  cmake_parse_arguments(COMPONENT "" "" "DEPENDS;HEADERS" ${ARGN})
  if(name STREQUAL core)
    set(exported palpate)
    set(output palpate)
  else()
    set(exported ${name})
    set(output palpate_${name})
    list(PREPEND COMPONENT_DEPENDS palpate)
  endif()
  set(target palpate_component_${exported})
  get_property(modules GLOBAL PROPERTY PALPATE_MODULES_${name})
  list(TRANSFORM modules REPLACE "(.+)" "$<TARGET_OBJECTS:\\1>" OUTPUT_VARIABLE objects)
  add_library(${target} ${objects})
  add_library(palpate::${exported} ALIAS ${target})
  set_target_properties(
    ${target} PROPERTIES OUTPUT_NAME ${output} EXPORT_NAME ${exported} LINKER_LANGUAGE CXX
                         ARCHIVE_OUTPUT_DIRECTORY "${PROJECT_BINARY_DIR}/lib"
                         LIBRARY_OUTPUT_DIRECTORY "${PROJECT_BINARY_DIR}/lib"
                         VERSION ${PROJECT_VERSION} SOVERSION ${PROJECT_VERSION_MAJOR}.${PROJECT_VERSION_MINOR}
                         LINK_DEPENDS "$<$<BOOL:${BUILD_SHARED_LIBS}>:${palpate_map}>")
  if(BUILD_SHARED_LIBS)
    target_link_options(${target} PRIVATE -Wl,--no-undefined -Wl,-Bsymbolic-functions
                        "-Wl,--version-script=${palpate_map}")
  endif()
  target_compile_features(${target} INTERFACE cxx_std_20)
  target_include_directories(${target} INTERFACE $<BUILD_INTERFACE:${PROJECT_SOURCE_DIR}/include>
                                                 $<INSTALL_INTERFACE:${CMAKE_INSTALL_INCLUDEDIR}>)
  list(TRANSFORM COMPONENT_DEPENDS PREPEND palpate_component_)
  target_link_libraries(${target} PUBLIC ${COMPONENT_DEPENDS})
  get_property(linked GLOBAL PROPERTY PALPATE_LIBRARIES_${name})
  list(PREPEND linked Threads::Threads)
  list(REMOVE_DUPLICATES linked)
  target_link_libraries(${target} PRIVATE ${linked})
  if(PALPATE_SANITIZE)
    target_link_options(${target} PUBLIC -fsanitize=${PALPATE_SANITIZE})
  endif()
  set_property(GLOBAL APPEND PROPERTY PALPATE_INSTALLED_COMPONENTS ${exported})
  set_property(GLOBAL PROPERTY PALPATE_HEADERS_${exported} ${COMPONENT_HEADERS})

  if(PALPATE_INSTALL)
    install(TARGETS ${target} EXPORT palpate-${exported}
            LIBRARY DESTINATION ${CMAKE_INSTALL_LIBDIR} ${palpate_install_runtime}
                    NAMELINK_COMPONENT development
            ARCHIVE DESTINATION ${CMAKE_INSTALL_LIBDIR} ${palpate_install_dev})
    install(EXPORT palpate-${exported} NAMESPACE palpate:: ${palpate_install_dev}
            DESTINATION ${CMAKE_INSTALL_LIBDIR}/cmake/palpate)
    palpate_install_pkgconfig(${exported} ${output} "${COMPONENT_DEPENDS}" "${linked}")
  endif()
endfunction()

# The file for pkg-config of a component. It finds its folder by its own place.
function(palpate_install_pkgconfig exported output depends linked)
  set(requires "")
  foreach(component IN LISTS depends)
    string(REGEX REPLACE "^palpate_component_" "" component ${component})
    if(NOT component STREQUAL palpate)
      string(PREPEND component palpate-)
    endif()
    list(APPEND requires ${component})
  endforeach()
  list(JOIN requires ", " requires)
  set(private "-lstdc++ -lm")
  foreach(library IN LISTS linked)
    if(library STREQUAL Threads::Threads)
      set(library pthread)
    elseif(TARGET ${library})
      string(REGEX REPLACE ".*::" "" library ${library})
      string(TOLOWER ${library} library)
      string(REGEX REPLACE "^(zlib)$" "z" library ${library})
    endif()
    string(APPEND private " -l${library}")
  endforeach()
  if(exported STREQUAL palpate)
    set(name palpate)
  else()
    set(name palpate-${exported})
  endif()
  file(RELATIVE_PATH up "/${CMAKE_INSTALL_LIBDIR}/pkgconfig" "/")
  string(REGEX REPLACE "/$" "" up "${up}")
  configure_file("${PROJECT_SOURCE_DIR}/cmake/palpate.pc.in" "${PROJECT_BINARY_DIR}/pkgconfig/${name}.pc" @ONLY)
  install(FILES "${PROJECT_BINARY_DIR}/pkgconfig/${name}.pc"
          DESTINATION ${CMAKE_INSTALL_LIBDIR}/pkgconfig ${palpate_install_dev})
endfunction()

# After all components: their headers, and palpateConfig.cmake.
function(palpate_install_config)
  if(NOT PALPATE_INSTALL)
    return()
  endif()
  set(elsewhere c cameras devices session viewer io/formats.h)
  list(TRANSFORM elsewhere REPLACE "(.+)" "REGEX;palpate/\\1$;EXCLUDE" OUTPUT_VARIABLE excluded)
  install(DIRECTORY "${PROJECT_SOURCE_DIR}/include/palpate" DESTINATION ${CMAKE_INSTALL_INCLUDEDIR}
          ${palpate_install_dev} ${excluded})
  get_property(components GLOBAL PROPERTY PALPATE_INSTALLED_COMPONENTS)
  foreach(component IN LISTS components)
    get_property(headers GLOBAL PROPERTY PALPATE_HEADERS_${component})
    foreach(header IN LISTS headers)
      get_filename_component(folder "palpate/${header}" DIRECTORY)
      if(IS_DIRECTORY "${PROJECT_SOURCE_DIR}/include/palpate/${header}")
        install(DIRECTORY "${PROJECT_SOURCE_DIR}/include/palpate/${header}"
                DESTINATION ${CMAKE_INSTALL_INCLUDEDIR}/${folder} ${palpate_install_dev})
      else()
        install(FILES "${PROJECT_SOURCE_DIR}/include/palpate/${header}"
                DESTINATION ${CMAKE_INSTALL_INCLUDEDIR}/${folder} ${palpate_install_dev})
      endif()
    endforeach()
  endforeach()
  if("scenes" IN_LIST palpate_components)
    install(FILES "${PROJECT_SOURCE_DIR}/scenes/scene.h"
            DESTINATION ${CMAKE_INSTALL_INCLUDEDIR}/palpate/scenes ${palpate_install_dev})
  endif()
  configure_package_config_file(
    "${PROJECT_SOURCE_DIR}/cmake/palpateConfig.cmake.in" "${PROJECT_BINARY_DIR}/palpateConfig.cmake"
    INSTALL_DESTINATION ${CMAKE_INSTALL_LIBDIR}/cmake/palpate)
  write_basic_package_version_file("${PROJECT_BINARY_DIR}/palpateConfigVersion.cmake"
                                   COMPATIBILITY SameMinorVersion)
  install(FILES "${PROJECT_BINARY_DIR}/palpateConfig.cmake" "${PROJECT_BINARY_DIR}/palpateConfigVersion.cmake"
          DESTINATION ${CMAKE_INSTALL_LIBDIR}/cmake/palpate ${palpate_install_dev})
endfunction()
