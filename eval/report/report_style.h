// What the page of the evaluation adds to the style of all our pages: colours of the methods that
// colour-blind people can tell apart, chips for verdicts, tables that fold on narrow screens.
#pragma once

namespace palpate::eval {

inline constexpr const char* kEvaluationStyle = R"css(
:root{--weighted:#1f66c1;--simplified:#a87400;--graph:#00795a;--graph-cap:#5f9a1e;--field:#cf3f0a;
--other1:#8447ad;--other2:#b8478a;--other3:#6f6428;--other4:#51647d;
--agrees:#0b7a53;--better:#1f66c1;--differs:#9a6700;--contradicts:#b3261e;--unmeasured:#626b7c}
@media(prefers-color-scheme:dark){:root{--weighted:#6aabff;--simplified:#f2b632;--graph:#3ccb9c;
--graph-cap:#b3dd62;--field:#ff8149;--other1:#cda2ee;--other2:#f593cb;--other3:#d5c673;--other4:#a9b9d1;
--agrees:#54d3a2;--better:#6aabff;--differs:#f2b632;--contradicts:#ff8078;--unmeasured:#9aa3b5}}
html{scroll-behavior:smooth}main{max-width:1320px}h1{font-size:30px}
h2{font-size:22px;margin:52px 0 8px;padding-top:10px;border-top:2px solid var(--line)}
h3{font-size:17px;margin:34px 0 6px;scroll-margin-top:12px}h3 .id{color:var(--soft);margin-right:8px;
font-variant-numeric:tabular-nums;text-decoration:none}h4{font-size:14px;margin:0 0 4px;font-weight:600}
a{color:var(--weighted)}nav{display:flex;flex-wrap:wrap;gap:6px 18px;margin:18px 0;font-size:14px}
.share{display:flex;height:12px;border-radius:6px;overflow:hidden;gap:2px;margin:18px 0 10px}
.share i{display:block;min-width:4px}.verdicts{display:flex;flex-wrap:wrap;gap:8px 22px;margin-bottom:20px}
.verdicts b{font-size:24px;margin-right:6px;letter-spacing:-.01em}
.chip{display:inline-block;white-space:nowrap;font-size:12px;font-weight:650;border-radius:20px;
padding:1px 9px;border:1px solid currentColor}
.v-agrees{color:var(--agrees)}.v-better{color:var(--better)}.v-differs{color:var(--differs)}
.v-contradicts{color:var(--contradicts)}.v-unmeasured{color:var(--unmeasured)}.share i{background:currentColor}
.first{border-left:4px solid var(--contradicts);background:var(--card);padding:4px 18px 12px;
border-radius:0 10px 10px 0;margin:14px 0}.first h2{border:0;margin:8px 0 4px;padding:0;font-size:18px}
.first dt{font-weight:600;margin-top:10px}.first dd{margin:0 0 0 14px}.first dd.thesis{color:var(--soft)}
table.claims td,table.data td,table.claims th,table.data th{text-align:left;padding:6px 14px 6px 0}
table.claims td+td,table.data td+td{text-align:left;padding-left:0;overflow-wrap:break-word}
table.data td.n,table.data th.n{text-align:right;font-variant-numeric:tabular-nums;padding-right:14px}
th{text-align:left;color:var(--soft);font-size:12px;font-weight:600;border-bottom:1px solid var(--line);
vertical-align:bottom}.claims .i{width:96px}.claims .t{color:var(--soft);width:40%}
.claims .v{width:130px}
.scroll{overflow-x:auto;margin:14px 0 0}.scroll table{width:auto;min-width:min(100%,480px)}
table.facts{width:auto}.facts td+td{text-align:left;padding-left:28px}.facts td:first-child{color:var(--soft)}
.plots{display:grid;grid-template-columns:repeat(auto-fill,minmax(min(100%,470px),1fr));gap:22px 30px;
margin-top:16px}.plots figure{margin:0}figcaption{font-size:14px;color:var(--fg)}
.picture{max-width:100%}.label{font-size:12px}.title{fill:var(--fg)}.zero{stroke:var(--event)}
.curve{stroke:currentColor;stroke-width:1.8;stroke-linecap:round}.dot{fill:currentColor}
.name{font-size:12px;font-weight:600;fill:currentColor}.leader{stroke:currentColor;stroke-width:.8;opacity:.5}
.m-weighted{color:var(--weighted)}.m-simplified{color:var(--simplified)}.m-graph{color:var(--graph)}
.m-graph-cap{color:var(--graph-cap)}.m-field{color:var(--field)}.m-exact{color:var(--fg)}
.m-thesis{color:var(--soft)}.m-other1{color:var(--other1)}.m-other2{color:var(--other2)}
.m-other3{color:var(--other3)}.m-other4{color:var(--other4)}
.curve.m-field{stroke-width:2.4}.curve.m-graph-cap{stroke-dasharray:7 3}
.curve.m-exact{stroke-dasharray:5 4;stroke-width:1.5}.curve.m-thesis{stroke-dasharray:1 4;stroke-width:2.4}
ul.notes{color:var(--soft);font-size:13px;padding-left:18px;margin:12px 0 0}
details{margin-top:12px;font-size:13px}summary{cursor:pointer;color:var(--soft)}
code{font:13px/1.4 ui-monospace,"SF Mono",Menlo,Consolas,monospace;background:var(--card);
padding:2px 6px;border-radius:5px;overflow-wrap:anywhere}
@media(max-width:760px){main{padding:18px 14px 40px}table.claims thead{display:none}
table.claims tr{display:block;border-bottom:1px solid var(--line);padding:8px 0}
table.claims td{display:block;border:0;padding:1px 0;width:auto}
.claims .t,.claims .i,.claims .v{width:auto}table.claims .t::before{content:"claim: "}table.claims .o::before{content:"measured: ";color:var(--soft)}}
@media print{nav,details{display:none}.fig,figure{break-inside:avoid}main{max-width:none;padding:0}
body{font-size:12px}h2{break-before:page}}
)css";

}  // namespace palpate::eval
