"""A NanoVDB file, written once with NanoVDB 10.0.1: the reference implementation, version 32.4, not used by destello.

Its grids "density", "double", "fp4", "fp8", "fp16", "fpn" (to 0.001) hold what `vdb_file.density` says, "heat"
1000 + 500 * density, "color" (density, density / 2, x), where the density is above 0: voxels of 0.5, index (0, 0, 0) at
(1, 2, 3), the array's first voxel at (-4, 3, 125), so that it lies across the borders of nodes of all kinds. "ball" is
the fog of a ball of radius 17 about the origin, from 0 at its surface to 1 at a depth of 3, in voxels of 1: eight
leaves in it are tiles. "turned" has 0.75 at (1, 2, 3), which its transform takes to (2, 2.875, 6); and 0.5 at
(-4500, 2, 3).
"""

from __future__ import annotations

import base64
import lzma
import struct
import zlib
from functools import cache

import numpy as np

_PACKED = (
    "{Wp48S^xk9=GL@E0stWa8~^|S5YJf5|Nr6#!(9L;7)i$<C?#@w6mwF{yeVg!(j)+n!8ctrJ1LzgX2tINvlm2AK84o@l%e1XIz!^n9nIM2o2RED{V"
    "U+pFf8I#K?worN^LzHU^o5c0L%wd=SI@7k!nBM?i)x>E!-"
    "j=?|Th1UeFwmlLiBx^bDxw;_>?IQw{x1bGFsj_5x1v#vR~Jt9&3l@QZ3yW>L4b<A;8b`tj(n`qYzq!mqUjl(*JQahnV8En`(^ULLcow02{k5tyIi"
    "CR7uY-6!MY8Tl^(PNX8A!A6eS|3qP{OfLlRBJJCAd&@UYU4%^Gt;ljjewlZ21Gtf}tES2DEMK&?y3gf>UC8N%B4LZe4-"
    "2C^sLxb;AeP(i?}zyoiWYBg!45lFlGLlJ7uJQfUZoX@?*Ue(sy4$%qrOl$D>I$GE)G&GeZistN-"
    "n9_I3I_*^<7a583=*R6GgJY=ul$F!gc1i2!6CLRQ!QRTb)?Z;=SuhhG~kZp@F7NDJM2>%K=!6R=hw3iXQ)zGU6Zgv*W_Wa@xAC&VP13h+pYzs#w^"
    "hdlL2E6qqly$Y_0Gr&@Zpi9k$Cte?V%BLGdp=I0Vbn6$eb9AE*71u}Pw^^~J<C{NHMmP2nbS3O#A1EuAS8#V71Xl~5yFhWUb(b{TQkz1-"
    "hWvSp`%%PY1=XCuF88S0TJ9d_nl1oyCN}i+-1Ll2vD6dw5vuO@w5@8`^e6sCV)DPzqkx$-thup(f4Yiq+V^hS{4?as~LXZ;<{}7Y-"
    "ZD}FK)B@~G$A`l#5UjML#l$Nrg?0sasMy!SQd)8)1LsS)_}twh!*`NSd0l^%0Yfy@;&Rn0BBr3Zrh<Dm+LM>|)D_FZ%QU-cGO>PfMsWxu0c{gqqf"
    "|y~_%^xryuWrb6Cdn$?r(Oz$4a|EtWBmnfqH@z@3u>$0VMHH=#zRY7?B8kK}7`i>gI0xgb94$Em*||20yCNITFV~F&ck1OSpNn?@5DS*Q`qd2E7s"
    "7buL)Pox(A7jb<)rdQ~Ow+Si}tWaj%~(+lFf2U*)<#7sL4{2*t<{ybRBlRk&8@`zq|=PdRAM+M@V*MgdB&b4`g$|b$*+@we@seLzJUH%z%;)p5(*"
    "E$n8g?%-"
    "mc@YdZ17Ie1lS3W_sARH{<lxEXYr)uvR(8DRrO}h;7<%B)wjYO#Oh0Cn7MMNBCP%*yFAald=ha1fiMKT;uJlvwuh1DvdtKYjg(;+!0A|O(Fcuqsx"
    "Rz;b4TvF8w-yAALb-^XSQVkTnNL|(QygjoN6$x;@aOv;+r%_svMQj23$pJ`tDL$U<|^-"
    "fV0+j(L?GOMai~wRcFT_TA6UX;41Wk}I&IuAW05Z4n^`HLz@@bW3&xRs#6D#=|B=<{qX7hd?>O98zP>Ckn-"
    "^iK^M2f8j$<#B$%xxd@@1$b8w`W;cj>1jNK`4Dm0#s_shM6+jRk6@Vq*Beptp<LzztjEzc)rASwR^IS*ai|nDr8~-"
    "mZ)Bv099dZQ6?8<62gG&LahKx$U61$#&#Nq#}%TRUNfy9dG+fh!AW-"
    "%ZNW*0FTg4uO=vzaUPsWPxSX@I7Ur)lqk;hlvBj^u=!M?Sy2&faawRb6N8GK?USL^ZIaZE+GgQS>OGlB7AuwcNBU0ZQsR;SrN(|&JuUiuF5~7t66"
    "?G4_u{-sjlIY>v5k;XMltxM_?knTL7Zkx9dnv=ttsKLx6k7UeKUe``G@yZUmKzcT{>fOK6vPc{Yu!g748F6ro2-"
    "hl0;T0l@FquFG#L&qiJrfMxhb4u>*gkv^wAZH>0fRhPmtO6hqL%EE5wQ(tsp$Dr=@ksi=8vJQI$PlSM*<dMr_VPzAjK<~{Rot_kfwVbS7~^_K1d|"
    "Gj?WBV`LEzbE}u%esxM{JiHR#Fa+h5vZiCLQ_EJ#mPV_!%1zgUL2ivJ4#CvZ?oRqLRlxWn%W*p0CU-"
    "6Cf3~VT+Pvu?yUY`xVSWosj2VR(*kmg!>Yyu21M2R-"
    "w+=@vtYxvP%z2X#~U&bJwm>sgXW8#*AMGZw#sK|Z5XSv_y0ERMF&IznA3x9<!HfYc))FW`5-T-"
    "{fjD@?me3e)EwYKIn(O%W<v?Sx6s5_y^n7G<?^?t7rs0ftm%9syJvvGG2EYnLal|?10J|uOHpQ0Sib3YtXbscTLlRD$J(v@`%)`(%^ZupqL#+a*o"
    ">hjKA1~d#s4OXZqe0x^F9<)Vs@-q<mFoh2>Hj_t^E5^D|F2sTOdOD-BUf);=tYk#;qBqBwWuUgjf8~ihB0d*M5Slm;fio`I-"
    "h_oOl28M}$CGPC9}U*f(|~YVg*=!i26bs%&^9JZRn+`HkDL0KqM)Bgwc;7=8B6<Uh{xc=;IOjpusq6jg><RgdKsvwsyQg<t5j;1)F7s5=O)Kl4Ry"
    "(2gVSgznMAJOb!cqMMiAgYnx=JjTvv0f7((0EuUv8TuyEwD5s~x7m+m5((31tx}TwV}A}JIar%h#2;B?XF_C)GBtw_290!d=f^!46S%<E)UC+@Pr"
    "{ySyB|%(!&63z{L?@jb)DE8T8_}|m?h&1%O%2?`Fcmi7oA2cUq))9oZ_^9Ccn%N&&8v+Lx#5vrlLjvV~n5wc?2W??i0~d&&(v1r8|vH9|RGqtzaF"
    "x&ao#LTv>+cW>Q$b>2|C!tt0D*vD8BE0;s@XgB!HyNQggN0FTg4uO=vzaUVU8B;jzLrz2nND9eS>m6(ctDv|Ohb@6)AJ(TQ0(r)6pQpWz$Uj3#9!"
    "lcw1Pmfr7Z*wzr)hlH^{BbB=$148HD;tCznhSn!OiQtJ3x#tWk^HVgE?5FlI;mb5IqG{fa?qk}{pnTvrTX1I*W_ReZ;vwDZ;@jI_E)1Q?J2`>NZg"
    "ihW>lp-"
    "9l(E2Oxq6vK+Q4_yTkH$0V3A4m|ntGbtzF!2@bS3M`o{>ZKmoFyRi%3_JRL9(N^xK&k@e+MYk4LLS*EIpRwTgPhg;`Z^ufHOAkJG@B4GpHm}I)8;"
    "MrdVru#;!hglSv?A_5@2B!nj(^o|ZyAZC5u7E{&nNA`0|DWCtvl#R!NgSd>B!aN%2gV^{s0=!H)Bh|1Wf`W?A8P^`!t5gfWpSluaLP^-"
    "7}azS^&wr#sXCcODjpxABn#!z1U@Py;9%d$o_dDwWu?XVuXEKQDTyGNnFFJ%;6E;I=))n!5ehv<H-"
    "P>6I&qQSS!U|QKIL&)p+If0e#$^zy_F2nElwV)sPRwB~$m0yG;X_nZ|^<`55Ju2k*g;%RgfdV8{GSr(`nXJ8hPInFIFN40!0T``#hL&E@M>KL)wE"
    "k>_%@nxiRkq4jE2-"
    "WvDR|JOotL7lZU|E*7jbtx|dM6?S<%alV><10UVcrm3yzO>V7ufT2KwNk<w(rsZ>u!QQ&JOy?jA~L8m?Gj@2kcTuOzO<dZS;Yqlf!f6K2)c-"
    "kFt4Vjm<*=RcP#9sAR7SM2Z}N?0kV*iEci3tNiusNkT>hlquZzCvr%~H(3@0WoQYgxbQ_cf7A-"
    ")ohlWFwQUur)>+nSAMtUj(*bbMTM3D0dr&0Ee<=(X2+M_$6q5@EYN$zZscZqWZ=dP1Y_Ft^vapeNZj)m5l5>vAyhW|$cgM{(615}W{y)D3`&%1ub"
    "-{!*n18N2k1Bb?DRKqZ(cp$5y{Um@<<mj`~`?6hCc{W``s%CZ0vF9cusQ3np+4X<c4I4jwcdLUGA)V;R1JI|U=eyN-<@5o4+?~J%m`#}d*ss-"
    ")55y%?`1O%CF$JZt?r*_xu$lewKB3V&pWR78-apU`9;>;A(!hW|rI~^sp4Y(g{w76X&fzOO-#(Et1GX{Y<ZogVDb~4P9j-k(fu@xIg-lgCD-"
    "!$^7zKJGl>QOLWRrPL3%nPkGlkdB$gtXTgagPm0q98f%FxWAss0{xB^rB#FfTsZ8jTU?vuJ(j^KRf4%)muxLpUpru(ss~__5%79?3@li!oso-"
    "3IFp0U?S4ZXvg4dh9*oB8rbzA#ctlpa0YZ?f~p_Q>XpDu6!{XpSO)MZg8HbBVX(&%Z1UOg8u}_QOI0t$=UUP)(sm!eRr#a6d`WW)q3+j6jNe$tXb"
    "saT=%?00d5d|daI={OGciw@05@-"
    "%#+YMIZFQtJvbHlmuzr?qh9p3FZPSk=m|?|+a7iPvF9cusQ3np+4X<c4I4jwcdLUGA#Tytdh<RMQ)6sAipQ@Wd}6fh%6#7YnlLU_z>kIVgMq+h#3"
    "fVs^^rC)1*Ndq3MgzDsJp_E{nY;CFc1e66hg&l^sQU^4WJd#ktQ(hA=Is<kPE}L2s2n>j)kk~tGo`$W_?th*nX*|v0%MViQN;QH3q1BTd;N*F6(o"
    "Ho)M&?h1T0X?#fvHKa-QKiCZ0b3Zrl*@8@iWAwhN)fnos!hR2jjFC^GQnUL?a+mebFrd*tYP!9lI`f$EOd(}-"
    "7$l4AM93Ox^j#r03clrb^#xjLIkjMz6BZY6dufG97pZP=)N%}Gv$_4v~Xn5pGGR-AA(X?++%2F$76!aXgfK8AJCqYl?5iiQ1i8NO7?`sCo(X+jru"
    "o2e@isuzkA09;%S6$6iSh+Rc{g&$V+frPa7Ydn~1^>eJT%^A0BN~#b9nOQe0Bde+?9B}q`bQG$$EsW-"
    "^>=CZ=8t2VaXk^z5WK7Qg~MEoAo=LZJWeTYBMZQ$O5q8JXi^F17PJ9{FlI!Mje#shxU|j**yNG7Jf^UIV&%EI+c77x99w_+F2m%&UA4s7nFW2uE3"
    "ijw>ZE-sP!m{Ry{H6kgy&P%gT?x0(woKDsnLpoepKy}bRFMi=2;{dEysm1O=?2A-"
    "L%$7CiwDg>zA?_bl7IEzXHh@g34oif$Z(#j*#mBEUvUksnBTW+DH|-"
    "zdq1eMVM~MQn2gwN>w9E_c#OW{S|*N>OlzcK5a)73jLlm0tC_2yhP1P5|(|s<zapEas*VI7nhU`4xUfOnITrG3MQ(P3CG8}y2ck!mu+%%hO)+LnK"
    "x?1l9;lAAbd93lb80?70bfQG`Ck8CvQni2@W7w^`XVhg#edI$k&U?h(BL3`^Zn|6Fs-"
    "%fVv~7_y&vF^?%k48$W$_jw{w061M8+(B=JxAN@!^aa4CV9VPnF6hoon;T5W>tx&`Iv2!nWdoL!#{AikUC-r=t@64Vke}Y6-"
    "V{jA1YNlf;+s2$>BL1|fuDc5X4OLu|1o4A|MWlJn3@h73EBRAF1x=}?D$ROp*!1+?J{pebzrJO_TYpn!Ga|i}KKm)vDq)PALZLkEdwLFf^}Z@See"
    "`0^r^VWD!)1n5oiOny=&$X$Y6D63fM)mYChuCtDM#6>7LV~V%?z8|-"
    "aftb)uSGNoF}KjEFq5b5RC1&S8t*RVWeTluEo5%C%0V&K<a^wPqRPp;EL*t2RueAm9hz9uVBQ@ZI`_TAmMr7oI!Vxu&O`whI^Yr<u+kU#E=wbKB1"
    "e=2wm8_q_Q30m&}rnBDRv6y`pS&ULnimog_u^L;&u{jy!Tm<m6J;@%@%+GQ9oN$3Xkt_D1wo`i1mz)lC82^%-?{G3;I}Q-"
    "a=Gse{ada6bpuV>F|y9c;}QtP)EuXch?O(3YPfu<|hioS6UK_<4cmrXnESD4`wMUtB#sns7_T#^(P|k3q~gL>gR|yc~d~pmQ)3pZ}WzLjde^Q>Xp"
    "Du6!{XpSO)MZg8HbBVID_ElCGYwqz#4Y#TN0C*8Jxm=j3;Q-0&)4@|?7OA1H!ExvKQ6nk-kfw<9)zJQvG9tu7cfS9U)%PMT&wL9>{y)Iv3{?k;(X"
    ">JK0@MD~6>Y^(I?qs`Z&M*vldOt?@^fa}oaK+u?O#Q6mFLbK$cm2Mud@&lIw~aAwaGs|lU+gHoJgVX7)HO7@qN;xk7{QLHjmcqxk6%rZJ}M<F1gm"
    "<6Vyp-R+)mwVmCH)#D~~=y*;<F<k_J{8o<yGF(&R?=RPcy(B{D@$_N~X+afi4zAt5!u@Q>Ny>XoA0z`_Dx;7#!!py==V!l2$=%tT}GIBbAzf2-"
    "0>+KMkPk0jx6o~I*U>?q5H(Uq8r;)cP{`<VobAy}UY6~d0Z5Y7-RRC0iGGQT4V>faCjyu28mpMz;xq)Z=2|NgB7Va-"
    "2SFrenkTumF)S9r4je3Dk(QR5UtvIs)WiN1_7uq)t{ylxZR>!86awj+ikbn^iocVc#|S>)wg1qk`a+O7QiQY&=L9$O$n`Q1c}pq7C-"
    "unoQNd1=xSh|Gp~UOJ<Gq;wtw-vU}dW#NPP=fV@D<zz<;(UB3VtzaFx&ao#LTv>+cW>Q$b>2|e3{;)Q#o-"
    "!)fA&aa{vP3l!7|5b{*d($(oi%d6tjpKJ42t}PHYOEtC8}vZpz-"
    "$>0(Y!36%_zg1`$ulsaA$a!Qm}sg4&20XRk2XYj`ee83t3F;cEZlw+G)epN`si8tnkTv)L5B4gEGz^UX5ngN`d^c0fu^1g?@)s`LceOlJakFmO*U"
    "J7=%09<nr<)_;;Ej*R2tdN$WD2cOj1XR8l;&}AZ_5oqV_q?@EBPS|%-"
    "rfXU#zh2DvsJ*<<a@rE{v_<0f0w4r+jNAr{K{iaFH!4*4wT;jSE6Rcc%>@`jmRGebWMh~yes{GG<Zr5_i+Q0EbJ+$e!;Q$HeAieeWw$`u*eC9XrH"
    "DGI9jt)+2yGOd1#cZ0WlTo>zA8r2u(<Di7L6SBrqF@rw9Z6&(ljhaIQs^%@rsYbU=7$hIsxDqoEt_;NLk|o;&dQ#o2gIpCl4#HXV@AcR+S?e`Wn_"
    "r)XgQT_KK+k8@40GQ4sgPo`N0#i-J-A<S*`nLm_ODvoWXpeH<oW0#;h+&XJj@JMS`7{upv`Cmdo}jcZ9HC`oUMTh)iC)g$<>Zt2pk`G5K-"
    "ls{U#CFwiOuY?0tIm2Ci&pcphgX~x+$jIFI#qd4{5RHdD44Jbq4jqPrODoRBQuyXBFuWzg2T{|JRGMeuPQMGRCO?xTcWzp1C$D;)a=4uVHByxI*v"
    "spZ_Y8&R5u7l`@RJ^TDvO9w7($bWkAYQ}3;m<Fq%DH4@490}-"
    "QFIJL$<yWcj?#mtB^j4E6GNLwqao>nN5TsBUn%1PT9oEYjcqyjFkS=iv)7JyWDN4LiS8May!3W_$K7vM4grD556=qx&SEN8y)`#oi%nc>Kf9;6$9"
    "FIMZ}x&`+opXz;#ogF1;zoCml{S&{K?|WDVUECv&1miwMQH2EsTf-wtCU!ZqFE{&E+xE`8zv*;DQ#(9k;Gtvj_5<J!!pgEtMILf{t^&#DGAxoCeM"
    "!O$#v83#>Q`kU3cM*PW6gNliQG*NO51ugeso|6~DTyI&h*`O|ZxUEGgO7B8mldJ?Gh`amiiGBll)CuPEaaDvYp{_RvSbypAZmO%-"
    ";!1*^V!?vRJhT{#x8)NkWPbt5MRpeeUJb7NvexESz-kNOvCHZ_!>y-"
    "0Sh~@fcp==<N%*Q6e=%U&$tv=xvwS#WyMvjXB$e|o#g%|&Ejq6Gz)W`Zbeh8#XipIEGe6<Z+50?`F?V!hR!cKE;M}T05Dm<k0!>$;g({%kmQ#$zK"
    "j7?OOD#xQ7g!V(-_GZVX`J+@`ptwK)8VP(#?hbA&CRw}gu<?5#&`5T4`&g1tXfqLVvL-"
    "~>PP#+%n{s1B#V(WyfK0&EVU(O!>?*M%{^SWQ|ww+%?=)c_DA*(7#a~8FMH`vP0Qu|Rl7rk9M5T^)PKy|N^Plv)+}Q??=2bb9J=`GMsX8&Q#m-"
    "9Qzf967LFVk^kl$DDe|;vK)f&XvE3RK3`FNcj)h3;`=<{zEY!$s-I2t6YEJ;86#s$idJw1AbwoC`6|lgOyp2Y=!KslunGYit!_0K)fW@b1S5{^-"
    "{&!Di<<NH;*+AEpo$+Wy4zS<jqXHuUh}AGmgfIYjy^=`X=~mnf$EqQ6P?A{PG&mPr%ab)yjhGANU%7T^GWajiw<eOE$$W7Cozeov_t%(3aXJwu1K"
    "&Vi*7KnAyO?%pQ|0~VLvtwG79wFWPR}2V|G~r1mLO{%&lr4n$BFc3vwM2(plW&IZe0*17_c&Rg4|)Od__bqwmWQ$j;BH&*TrV4hsIa|0iA!=)MGI"
    "Yzrv3cKGr*ePrjxTUJGv6Yr&=K`{#`=<GiE`o#$@d#7;7^;v)|eFAYs}$OlH6^6`}5m^9O9+sf^eLpp2JChl@{)hCCH-"
    "81dEf~5gM+!J?dGVP~xMORr^6>j365Y-|jI2j(+G{E^NhFUgW94Bc5##A-"
    "=2pIIQgoq6kb3_pZD0Eh?j(J_25F_Z!PsEgO&QmkF>*+6ZtMr)_@xWdKv`;R(4_6HN+4eyv!=Z}RQ`QlbAL*>9GAc;1dps`@(1?&DQoii=m9w-"
    "@#`X@A26C9jyl>I^`iVhBKiqFf;Y)0Op^R=Nc{#W|=J5b9r7BfyYI}Nx?xe-i!b~AXX@D&4D)u-"
    "aYOK%+%{I)7;RjsE40wDYzKwXhT%hhqp;rwW`-"
    "dZ}TSqcHVuM0>y4pt%Ve+44(Pu`<H(B`(!^0T+YM$hZWf!ryIVT~#Nnj@g((gRjH2zIYOQqeP3o8stpH5vUB;53?Tu&uthsia2W~P^)T|s-"
    "kFo){4@pg8{v5AeKNhf+J<^@cCP2&$13_z8hbsZO2!<G}mlhZRa?^*SMi%-KZ)wAxvyH951XEW^Tb|V}nG?J4jfSsH4fnb}=8exem@dlx)u>u(-"
    "U|-_oxzuDtuQ)A9aJ{jo^)`>Z53*A<gx|vu&)~a!x(Hj!^q=~HLChO!GA|G--exS5IOS+VHz9v*JB=q@tEK3;tl2!oYpIA<<7<351@0GlzHJYAz?"
    "jR|ZrnT8WjmM?4(~5FN{xW6Nsq(K*K>QWmdRL0W-"
    "?rt_>y!jgQWlkAzuH=>um+vI{!VG{lWD35)$mTP=5unwa2&d=9p>zp2pZ+4RSkN$ZbMFQ|6ALmkAuOo=GQ)i-{EuaCuhR+Picyz6jal`-"
    "XSyNw?kGq}LBHvGmVBzh4O-{7zd%-qQ<Tz~KV9&U|2#gY!vbrOs;+X-xTX`XFpOh2rA`ET)7NS8|e_T1-eX9R@?Q|6%d1{H^34Hlz|L>98AFT-"
    "eB-VHf@4KMz0DMUz^M!0cN?#sZ_Gihh?VbOn4HkZ+DYhDGG!{xQ>XNQ%<AqdR5Sk|yw#bar*o3AX4Gzsb3VgLoopMjN6rMQ}Sg>{s{|S2${qcWDB"
    "i`<fX!N2ATfZyd<1LELJoLIeH*&giAs5vY7T`;P#;<-zc1%`--QF;a0j$l4U4n(j+>pK~57kHS)yzT5@qQg`rID}k~kdA!5H7=iV-"
    "{9x2THgEc>SKCE4x3yESPB;SFF3h}@eVWc$tdga18Zc!%-ya?!lYJt5HUXek2JE`tjSWWzu5Iiif_8fS7oJ8vI{Wj6w6-IY{Rdmfo~J43ZSv-"
    "t)8E&cvQz5W4Po&;l0sZSLNLBUS_+}*8l#1c_BS!b2F<NTQoCtR2V~aD7U06Mi;N=Ywv@qM^wtukfhIxYAhk)PiT8Bv#Fxg`zyh-"
    ";5mbci+clM4ZJ16L1dNsfx;=SJ&__tjsQIhR+^HjTcL~dtn!xTn3DN7SKvyTEa5EzDw~@Yh1bBtOG~Ophxhi6b?&uzXt0=2_EYo(KiSlKAlDFZ7H"
    "W_p|HVx|wzc60O2POV{(~dY^^wB=Tr%XaaH;pChQ>bIS%>;bO2p(TXS|#oirg?B(9@unii(c@hnvQjR5LpJafKG9<(C#);<Abtmw~RuKo_YLb4Gt"
    "pPc~&m9ZM!EQx9V8Jauc0LWBKu`07u1&tyab<NhU+ZZcc=xf9|&vx3fq0<90{UQY&f{QeGwC56=U_?{4*hV{OI12*!er#as`lB6R7T2fS=f?ZaQe"
    "qLVl559!~+qWdn{Z~V_5&)dw&0d8mrPOrWp#;aq=y)Xnz;`u}UYMwfs1v}IFhDRnha0|Z*Fp0Kq*2ndk(nzyNVqK^~8_M^{7h@bsu}k9V6b3-"
    "|bb#d|&X2n!^zF1bR-GCGcH(kv9#+;49BnXYxRrjDKdXRNgoQ>jiR%daVQ{ezW8Kv0$B5kO6@u`r7`og$hFk+*akhL=Kf$uuJl8tFhMjr7jS4+*r"
    "(D`CW;f`H^<l{jN|)ft2pvpsA~%g&9^)gAI13Y&KWEkD4!_osc$_9VWWHXoSo!R)X$nN)>)7pncWImh5egspir5>e9kw(`;HxC00T_WbneS|m(?5"
    "Y|>$(GVd&U|d)ai<_8=;#3a3FIuEZ9h-"
    "ckz=OOXoeGLAJ3YmMn2QETObHEaa*S!X@Q6uhfZM<7e7PHVYnS%H0PNrk8x12tBMFEBCv9|Jr5VNdA0KlLWb8d|hBbu=EFw&GfJhU~hwJ$hgq^OB"
    "Kz}m)@S__>?5S9#xu|k&B2As~7vYjoohb9!vF?{D6|70A5tJ_-wG+<VIls)@vBJ+9_KlA4Pktd^@m)---"
    "e_5o`*sl%s7{W+02PeyIUSpo!?z0K!~7CPX#!{iuru8ge267r<XL3RJS*Ab3*J`|&(QhY><e>92>hA2fve`u|$YRMG%+Q-"
    "nzcIoc^Fut_qj85wGhJJDp3zN39Vp#3YWCt4$-"
    "NDO35SK6xYWG|OtHm;ZJ?1LEvG_xmOuwawt9UyQ#s8t<vgV_(<nju{(BQUqjWzwJMc??p7%{4m7H1Zk-Bx9;eFB-NY(C>)dAQQ1U=yYTp;y6brjc"
    "CMEP2vd^eq)oKd{ASG%KfVzI7@X^ErN2Tj&22t4zXIjYr%3V)*?b{<H-"
    "zuq_jBx><Mx+N`7y9_h!R_lmCAgoN^v6^0+ogPi_<(n$$XBSy{0|?2ta-Lfq?=U7}E;A3FEQFc7ab<u+zRrAcNoqRxTQy<S8egk+zy&hB~>vIi=f"
    "JMMqBB~uZq!RnqGqnV36DLxd_8}xzYxi3p11AGOkpE?!uyFK+C=C?n{!{X~SX+uqUdZqoE;tEcU+M|c+kHe#chPX)d`i6m%JXpH-"
    "9!whx`3Fd;ai*B<hpq$|AP6FnC4|RqL1Y#!DEQzbU~<W&fQGpj$A_-?yN9+@j~2h)mI-nEaA`OaGYb`1IPJH^yN>vf*7+R5FFeek4FbfGdbx1tg`"
    "2J?l)S~JV<r^T!A|pdkqr4_ZMb*eYO%FY1(~}l#CC{RGjA#7e2(~~WKcjXe9Ma(6A}tp`8;lF|4UQC_}cJje-#68_E3>f;ss7^A3Hp-"
    "d(u$nR4<rnD&PP5KI6kui>n^H1LjLN`Gq}d-@t}}6Q=TCR}}i_@qQN_`hja6IBPiVK`>99kl%X!<d#EeV-"
    "T?n=G<G_hh2+R^iuhO>E0jXQfn)lg}|0u@DkmZjea*7_8>1__~6F|cvYuTG@|qtAz1fnORVw=|0?Po3$K-"
    "Egr_)M+8ihopl$2P3{ofCP4%*jEa9axE9`ao!K*cqTv^viR}U9CI6HcNw%(R}37XH`?U&#6n2*#o7Zl26-"
    "(N!w!A0RdcWb24huwg`Sdlf<|BkG_k_^RxASGGuApm-2&Uqqsl8KYGx~<WBHxkm1ee10vh<M9Wr{90DDwFc(2FzkLHLIkm4-Xo>3!{Q-"
    "3?qTCED=ca8Jdq4Azp=;xYrOWVE$K^MEmZ}<hP6r{pgS?eA?a_efFf2)?etO;SrmW+tJrHn|1}f8n@h-d+i#nVt|W;-"
    "Ci+Tq9Rf7odD|YS<`q64|J%lwOo<#eTgKz*0^MwthU>z_7KZ?YnT%blA1orx&TM4OCYFOx?-"
    "rkavH)<2;L$Ayq`S~Ge%<wsd<{HtY;zSN0kk;J_x^_jcm`K%n_!9ltck+pA;E`Cks<WQuwA2B3%nsF+<QX)|vnzPgn){6w@zGQh^c;oj-"
    "Z$@Q?SC0DqF;Yt7>FpRYv&&Ts5n{ARdfxZ&4H4+zv-1;k*zdhrxm?~o~-"
    "v%$v02J|_My(WX@!jcVzOpE~rmndRd<fs=89uza{aYu#~_GV`L^U(J}x}nG6g-}d;Vv@Tt0nyZW_(^9-O(XZgYW86FpVOyV^auIIq_fPp9m=o@(-"
    "I#@5;)<9jJM;TF9)v>wMGNZTYWCZO(gvR$pc+4&5c<J+yEJ1aP3ITgmwW=P;ey;`K=c1>H~fNqhthL3(YVwd3HosCN2p>e|S(T+rHYLskPWEyr?f"
    "YP2@2MRIsis8b6-@1{Gx1!AfmnXkjNfQ*w79p3!%Nelhb}%4?_2x}!vkCx2?i4w1afMliglRtW?gV+;0=ig#+>_|p*iQ7cMP?B7$uJg^Y-"
    "Gu1(y9uh|POR^x+4Ej`RoR~K&Ay~r~Dsl8?@lJenp379qg<u=|3m^)1E&HmCTzA^|e4!f=H$Ff<aJm*p8<evCbKNw@Ng#{GL|cJO)y;*R;~)%hws"
    "Gpg8#P)w=RyaGUONvOXcet&NL3fDa10)E&juvKwD@81&h&mEr$r0qWersxcKUF-vt|z5<h7Q}tYapzU=iREMp1;Qxo3k@Bwr1!VejvXpvn?EnjFH"
    "#imIIs=qG7lHf#zQMq43e=C<dg$uh==3zY{1$ur0{;JtxJm6y50gF7d@a*q@9^jhaxq=`c5<Z}Gy1S)%UWf8w0TzH=6mfMcGFw1mWCP{VOcN1MfX"
    "nlD4hzY`MQ}jPySJWhcp}qt!IBt(&2Sa6#q>MVe{0gfw@LsYLj;7qeWJ(h4x;ZdM7ca*Bg?4c`-lIgz=@vgol8gfi7>Ogd7K9Kkmk=YKqo`-"
    "g<2RRc6}{ruQu0WMZ%YbDT`5_{j=)x*i)>@jxgHv&!A)?b3iN0K5FIK3^9gVVg8UAl&c_>m=@Q|h@9<9JH@0Kx@LR}&lAHhDhGK6F39}Df729b`C"
    "<-G-4`aAd12t!p-sQKavqu*N1)Ojr%Ms2Bv-8sRb(U?agqNO+xcXX)lNoV?!$=4SmbBWm9#{Q&a>cA(Q3Y4M3^%*@HB%s#&m_2eb-"
    "l$IXX+`%4>3q$s<yC#Px(_S(Gs$Rkpjqed2EAtcAFXC#>M&Ud}<rI+>N<Vn6c7!vJuSFm|YMRdjw-ME8u9jb?h8(v8JT*`sO4b8jBz)k@bQ=`xL5"
    ")RcdPqSf6kS5CsaqA~ezo)4dGIr^b7JUpcnL^9>6;HdVlDt}%G3d=ZF!XTSN?bO3obKDREu;+}^q5FUs*I5xDz>CQI_R@(mmHyWY5fU>Fa$V?;rM"
    "k@mBsi`}T<Id;>L@Gcz%X6d!>~&4=Yva=ci)KSzM?9H_|Nh}OD?<Su*toGXAlVgZQwSA?bbfn(_LF}5>Fhz~TII#nv200u3ue<B1q<WvNwo@MvE?"
    "eAQ7`n1Qc8m!Gm`$?4XKf|*z7jE5>P|qgp%~t+eJDZBo^k}q2w%yqrnWxFGlel)G@tYU4E8xnlZ6%FM8eek3&-~EH=bEyt5#7-sJ4K-"
    "4^6};4Sp7r?Cd>hEj$Lnycuouxz5kPx-tw3^EPo2{P}L<SL5;%ZEWXE)=goCv2LbB<*f5lBf};{RX5YQ^Fq{GZymHS?9?pD-"
    "|mM4g0eY0*T{if)On^4*?4x#`R-"
    "wGc<_|#B8~|loDrZ0>j+cjSAG|2jUPbAWMCDMJXDs`iTU6T!}PCChcTzu~MIuh8um@8r7~){^XY7$v)IAFyqmxCEW(z5uridL7tJV+S(xUH?0X=v"
    "7;3tJ+f*ZTNh*Dr<O$G>DHjV2I3@WnuyDbd~01}Qwu0BNn%`FUpqF`7@>pafV(ri+}N&N{ktP?kAAoa^Oi9HGz|<t<c3kNBIE+l#8t({X(KzZ2$S"
    "ez39_5ReggNiy?2G+L6I@r!+}f*M0vLw5ry+Fy-MGyx1B=<{=%Z3WKmCp1Pujzyq>|EFdhejy3f(t<|}ZEAp#1j1LESw8f$$qk6(5bpo{BHgGLpQ"
    "EYs!#sxQOaN^$u=aF%cD_XYdQBHPHUDlNK9`KQ#0y$;|o_u}N=1ATu8*B<gbMEm%~ne?azVOg!DH^rudy@1P9G>C3nT0v-"
    "aha3>{lr&`h*L2yp0Is++yfl+aI_TW7QZDaEOeq6GGVP4xP)}GcQOn%m%}3OzF>U!2ahN}P6)&L$xX*c5Hb`yCJ&tluTLiQRWtbEH-"
    "#|>h^p2rL(i1n11ib`<pTgt&am@S_hQ#ZozI=cc4izs07mV&w9(YXhs13~h&th?KFynIGrquPWi_=<>uRX;7-"
    "`e6hGtvkh1qfvr*wl{nF;?b5z*PW_ccZNosL6gxqQB8~18OpTWWMNd=wg_1Y|4V3R#g80J|;D0!tG!eOT+jnIpeqadpbGNBrm)wF^0%!jq^u<h85"
    "mkqe#%MKwlvkyt8BwU^VkP%k1Mi`&tSy0Rs<mAv&w9esJmDL}ljl?$<=SrpP^n?_q~-"
    "i7L;~TcW|8+X0?#xO(XKT)5%Ia5e8G>p=A|7or19OfWIi!oj5_E)oO_biUcStM^{c_NMNYz>*Eu5j=(WO_J0u3q!iEI}32sSg?;$3tt7O_|q25#q"
    "(WhzlQNbK{|ksDIu16p7X4UuWQha!Mon>bp{dg32Hs@#`k672iK{;BO6;nz%)@7He53Vb3-"
    "RFGe+`Mkoz~5Q0lWmSFnQjuu(I@xnx32cAOKMpDUY)(j)rtdgFxxzp7wfl-4i};)&3$0b%&G%0hahjBpGC8l*2gbXkbAw-FakNKmW+;CQsa4@PxR"
    "<hG6HtKbVPZl4trL{+PMUU_3WwxMAjLCV}fqV)bv0$)eC9-2VdYdYvn7%(~_t=rNA6Hy%-O>iBGqEX%8QsG-9W@m1=8SXu-"
    "u3>N?DzH3#Tiz1{54pv5^MSppDqXCr5yiTpbXa|k%Wq!kQh)s@tKE{ruIjw~(WKomDJbKP73V%JknXsU)^U14^|o&_5?`SgY=T~Se}CuSDMdAh4K"
    "&{%>#!1TcAlVzqi7=o<gY1SI97WeYchL1DgCQTPrlhHN_lyxOPfjCS%HYry4onbK*b)Mxv~OJ^7>j|VUY64hZB7*sO#k+siPPxU8A)ixZB0%-"
    "=WYQ`whfsit{guAMbTM?gOVXdT3dGQ})Er^e+Fj2+xjwf8pHp#}TBam??Ah|53kn87o0vz;-"
    "qFR6O3Qcvg^1fI{z`l=Ry$5Jq4K(G~~o8`cO+H6%!W0DW;s)}8h|FDqq2o3A;zz<{f3^Ap>l^ax?l6uUUV6t(3eABRU!AVT@wQ$6@8WB>Tubpnc5"
    "GcpakRjE)}`?_P_3})<_oBtWpfvh_DQ)&&sb*?9O%hM@I*Irg+oQ2#9XoVi@q=0t+TOm|DEGu-"
    ")9$O$n`Q1}J_$g!wJAlh7Y~QsaSXJdIe;R%gAHWFJw1R&aUL-*e?8}Gw<f)ykh`V$aX5qTXYww}}YVU+dGO#N4magG-"
    "^MA~nj68%4$lb^Syt<WYCrmPPRAS7>kS@&;$CS_j00000pupD$Ci1u_00FsN$FjQw0sC(*vBYQl0ssI200dcD"
)

_ENTRY = struct.Struct("<4Q2I6d6i3dI4I3I2HI")


@cache
def nvdb_bytes() -> bytes:
    """The file: ten grids, none packed."""
    return lzma.decompress(base64.b85decode(_PACKED))


@cache
def grids() -> dict[str, bytes]:
    """The grids' own bytes, by a reading of the container that knows this file."""
    data, at, entries = nvdb_bytes(), 16, []
    for _ in range(10):
        fields = _ENTRY.unpack_from(data, at)
        at += _ENTRY.size + fields[21]
        entries.append((data[at - fields[21] : at - 1].decode(), fields[0]))
    found = {}
    for name, size in entries:
        found[name] = data[at : at + size]
        at += size
    assert at == len(data)
    return found


@cache
def half(name: str) -> bytes:
    """A grid of floats with its values in half precision (type 9): by PNanoVDB.h only leaves are shorter then."""
    data = bytearray(grids()[name])
    tree = 672
    offsets, counts = struct.unpack_from("<4Q", data, tree), struct.unpack_from("<3I", data, tree + 32)
    leaf, lower, upper, _ = (tree + offset for offset in offsets)
    assert leaf + counts[0] * 2144 == len(data)  # leaves come last
    for first, count, size, bits, table in (
        (upper, counts[2], 270400, 32**3, 8256),
        (lower, counts[1], 33856, 16**3, 1088),
    ):
        for at in range(first, first + count * size, size):
            masks = np.frombuffer(bytes(data[at + 32 : at + 32 + bits // 4]), np.uint8)
            child = np.unpackbits(masks[bits // 8 :], bitorder="little")
            for i in range(bits):
                place = at + table + 8 * i
                if not child[i]:
                    data[place : place + 8] = _half(data[place : place + 4]).ljust(8, b"\0")
                elif first == lower:
                    number = (at + struct.unpack_from("<q", data, place)[0] - leaf) // 2144
                    struct.pack_into("<q", data, place, leaf + number * 1120 - at)
    leaves = [data[at : at + 2144] for at in range(leaf, len(data), 2144)]
    made = data[:leaf] + b"".join(part[:80].ljust(96, b"\0") + _half(part[96:]) for part in leaves)
    struct.pack_into("<Q", made, 32, len(made))
    struct.pack_into("<I", made, 636, 9)
    return bytes(made)


def _half(floats: bytes | bytearray) -> bytes:
    return np.frombuffer(bytes(floats), "<f4").astype("<f2").tobytes()


def newer(grid: bytes, minor: int) -> bytes:
    """The grid as NanoVDB 32.7 and later write it: with another word at its beginning, and their version."""
    return b"NanoVDB1" + grid[8:16] + ((32 << 21) | (minor << 10)).to_bytes(4, "little") + grid[20:]


def container(*names: str, codec: int = 0, magic: bytes = b"NanoVDB2") -> bytes:
    """A file with some of the grids in one segment. codec: 0 none, 1 ZIP, 2 Blosc in chunks of 2^18 bytes."""
    version = (32 << 21) | (7 << 10)
    head, body = struct.pack("<8sIHH", magic, version, len(names), codec), b""
    for name in names:
        grid = grids()[name]
        packed = grid if codec == 0 else b"".join(_chunks(grid, codec))
        entry = (
            len(grid),
            len(packed),
            0,
            0,
            1,
            2,
            *[0.0] * 6,
            *[0] * 6,
            *[1.0] * 3,
            len(name) + 1,
            *[0] * 7,
            codec,
            0,
            version,
        )
        head += _ENTRY.pack(*entry) + name.encode() + b"\0"
        body += packed
    return head + body


def _chunks(grid: bytes, codec: int) -> list[bytes]:
    import blosc

    if codec == 1:
        chunks = [zlib.compress(grid)]
    else:
        step = 1 << 18
        parts = [grid[i : i + step] for i in range(0, len(grid), step)]
        chunks = [blosc.compress(part, typesize=4, clevel=9, cname="lz4") for part in parts]
    return [len(chunk).to_bytes(8, "little") + chunk for chunk in chunks]
