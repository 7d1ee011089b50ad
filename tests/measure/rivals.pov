// rivals.pov: the scenes of `make rivals` for POV-Ray: povray +Itests/measure/rivals.pov +Lbuild/rivals/SCENE Declare=Samples=100
// `Samples`: per ray through the gas; `Suns`: along each side of the sun's grid of lights; `Method`: 2 or 3, of media.
#version 3.7;
#include "scene.inc" // from `rivals prepare`, as are mesh.inc and density.df3

global_settings { assumed_gamma 1 adc_bailout 0 max_trace_level 20 }
#default { finish { ambient 0 diffuse 1 } }
#ifndef (Samples) #declare Samples = 100; #end
#ifndef (Suns) #declare Suns = 8; #end
#ifndef (Method) #declare Method = 2; #end
#ifndef (Threshold) #declare Threshold = 0.01; #end

// Larger, since POV-Ray drops shadows nearer than 0.001.
#declare Unit = 100;

camera { location Unit * Eye direction Ahead right 2 * Half * Right up 2 * Half * Up }

// Irradiance E gives a surface of reflectance r the radiance r E / pi, and POV-Ray's r times the light's color.
#if (SunAngle > 0)
    #declare Far = 1e6;
    // The grid has points on its rim. It is made smaller, so that each stands for a cell of the sun's disc.
    #declare Side = vnormalize(vcross(Toward, y)) * 2 * Far * tan(SunAngle / 2) * (Suns - 1) / Suns;
    light_source {
        Far * Toward, rgb Irradiance / pi
        area_light Side, vcross(vnormalize(Toward), Side), Suns, Suns circular orient adaptive 0
    }
#else
    light_source { 1e6 * Toward, rgb Irradiance / pi parallel point_at 0 }
#end

#if (Triangles > 0)
    union { #include "mesh.inc" scale Unit }
#end

// POV-Ray's isotropic gas scatters `scattering` times the light's color per length: that of coefficient s scatters
// s E / (4 pi), s / 4 of that color. `extinction` is the factor from there to the whole of it.
// Above the ground by a hair: where rays start within the box, some miss its shadow.
#declare Low = First;
#if (Triangles > 0) #declare Low = <First.x, max(First.y, 5e-5), First.z>; #end
box {
    Low, Last
    hollow
    pigment { rgbt 1 }
    interior {
        media {
            method Method
            #if (Method = 2) intervals Samples samples 1, 1
            #else intervals 1 samples Samples, Samples aa_level 4 aa_threshold Threshold #end
            scattering { 1, rgb Extinction / Unit * Albedo / 4 extinction 4 / Albedo }
            #if (IsBlob)
                density {
                    function { 0.5 * exp(-0.5 * (x * x + y * y + z * z)) }
                    color_map { [0 rgb 0] [1 rgb 2] }
                    scale BlobWidth
                    translate BlobCentre
                }
            #else
                density {
                    density_file df3 "density.df3" interpolate 1
                    color_map { [0 rgb 0] [1 rgb Most] }
                    scale Size * Edge // POV-Ray has voxel i of n at i / n of the file's cube
                    translate First
                }
            #end
        }
    }
    scale Unit
}
