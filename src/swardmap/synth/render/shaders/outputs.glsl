// RADIANCE: linear RGB, and in alpha the share of it that came from the sky. TRUTH: depth, label and thing.
#ifdef RADIANCE
layout(location = 0) out vec4 radiance;
#ifdef TRUTH
layout(location = 1) out float depth_m;
layout(location = 2) out uvec2 ids;
#endif
#else
layout(location = 0) out float depth_m;
layout(location = 1) out uvec2 ids;
#endif
